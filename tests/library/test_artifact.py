import os
import subprocess
import zipfile

import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st

from pandis.artifact import read_artifact, write_artifact, write_atomically
from pandis.errors import ArtifactError, PandisError

ARRAYS = {
    "points": np.arange(30, dtype=np.float32).reshape(10, 3),
    "stratum": np.array([1, 2, 3], np.uint8),
    "empty": np.zeros((0, 3)),
    "one": np.array(2.5),
}
ATTRIBUTES = {"frame": {"centre": [0.0, 1.0, 2.0], "scale": np.float64(0.5)}, "n": np.int64(3)}
PROVENANCE = {"stage": "test", "options": {"b": 1, "a": [1.5, None]}}


def write(path, arrays=ARRAYS, **extra):
    write_artifact(path, "samples", arrays, ATTRIBUTES | extra, PROVENANCE)
    return path


def test_round_trip(tmp_path):
    found = read_artifact(write(tmp_path / "a.zarr.zip"), "samples")
    assert found.arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert found.arrays[name].dtype == array.dtype
        assert np.array_equal(found.arrays[name], array)
    assert found.attributes == {"frame": {"centre": [0.0, 1.0, 2.0], "scale": 0.5}, "n": 3}
    assert found.provenance == PROVENANCE


def test_any_zarr_reader_opens_it(tmp_path):
    path = write(tmp_path / "a.zarr.zip")
    group = zarr.open_group(zarr.storage.ZipStore(path, mode="r"), mode="r")
    assert np.array_equal(group["points"][...], ARRAYS["points"])
    assert group.attrs["kind"] == "samples"


def test_same_content_same_bytes(tmp_path):
    one = write(tmp_path / "one.zarr.zip").read_bytes()
    reordered = dict(reversed(ARRAYS.items()))
    assert write(tmp_path / "two.zarr.zip", reordered).read_bytes() == one
    changed = ARRAYS | {"one": np.array(np.nextafter(2.5, 3))}
    assert write(tmp_path / "three.zarr.zip", changed).read_bytes() != one


def test_digest_covers_content_but_not_provenance(tmp_path):
    paths = [tmp_path / f"{i}.zarr.zip" for i in range(3)]
    write_artifact(paths[0], "samples", ARRAYS, ATTRIBUTES, PROVENANCE)
    write_artifact(paths[1], "samples", ARRAYS, ATTRIBUTES, {"stage": "other"})
    write_artifact(paths[2], "samples", ARRAYS, ATTRIBUTES | {"n": 4}, PROVENANCE)
    first, second, third = (read_artifact(path).digest for path in paths)
    assert first == second != third


def test_every_flipped_bit_is_noticed(tmp_path):
    """Exhaustive over a small file: data, headers, directory, comment, every byte."""
    path = tmp_path / "a.zarr.zip"
    write_artifact(path, "samples", {"one": np.array([1.0, 2.0])}, {}, {})
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for index in range(len(whole)):
        broken = bytearray(whole)
        broken[index] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        with pytest.raises(ArtifactError, match=r"damaged.*snakemake -j2 -R .*a\.zarr\.zip"):
            read_artifact(path)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_every_truncation_is_noticed(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("cut") / "a.zarr.zip"
    whole = write(path).read_bytes()
    path.write_bytes(whole[: data.draw(st.integers(0, len(whole) - 1))])
    with pytest.raises(ArtifactError):
        read_artifact(path)


def test_appended_bytes_are_noticed(tmp_path):
    path = write(tmp_path / "a.zarr.zip")
    path.write_bytes(path.read_bytes() + b"\0")
    with pytest.raises(ArtifactError):
        read_artifact(path)


def test_valid_checksum_over_swapped_array_is_noticed(tmp_path):
    """Somebody repacked the file, checksum and all, but not the digests inside."""
    import hashlib

    path = write(tmp_path / "a.zarr.zip")
    with zipfile.ZipFile(path) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    other = write(tmp_path / "b.zarr.zip", ARRAYS | {"points": ARRAYS["points"] + 1})
    with zipfile.ZipFile(other) as archive:
        chunk = next(n for n in archive.namelist() if n.startswith("points/c"))
        entries[chunk] = archive.read(chunk)
    with zipfile.ZipFile(path, "w") as archive:
        for name, value in entries.items():
            archive.writestr(name, value)
        archive.comment = b" " * 71
    data = path.read_bytes()[:-71]
    path.write_bytes(data + b"sha256:" + hashlib.sha256(data).hexdigest().encode())
    with pytest.raises(ArtifactError, match="array points differs"):
        read_artifact(path)


def test_wrong_kind_and_missing(tmp_path):
    path = write(tmp_path / "a.zarr.zip")
    with pytest.raises(ArtifactError, match="holds a samples, expected a mesh"):
        read_artifact(path, "mesh")
    with pytest.raises(ArtifactError, match=r"missing; build it with: snakemake"):
        read_artifact(tmp_path / "no.zarr.zip")


def test_failed_write_keeps_the_finished_artifact(tmp_path):
    path = write(tmp_path / "a.zarr.zip")
    before = path.read_bytes()
    with pytest.raises(ValueError, match="JSON"):
        write(path, bad=float("nan"))
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["a.zarr.zip"]


@pytest.fixture
def small_disk(tmp_path):
    folder = tmp_path / "small"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(folder)]
    if os.geteuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting a small tmpfs needs root and is not allowed here")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_full_disk_leaves_no_partial_file(small_disk):
    kept = write(small_disk / "kept.zarr.zip").read_bytes()
    noise = np.random.default_rng(0).random(200_000)
    with pytest.raises(
        PandisError, match=r"big\.zarr\.zip: cannot write: No space.*free some space"
    ):
        write_artifact(small_disk / "big.zarr.zip", "samples", {"noise": noise}, {}, {})
    with pytest.raises(PandisError, match="No space"):
        write_atomically(small_disk / "kept.zarr.zip", noise.tobytes())
    assert os.listdir(small_disk) == ["kept.zarr.zip"]
    assert (small_disk / "kept.zarr.zip").read_bytes() == kept


def test_leftover_of_a_killed_writer_is_swept(tmp_path):
    (tmp_path / ".a.zarr.zip.part").write_bytes(b"half")
    write(tmp_path / "a.zarr.zip")
    assert os.listdir(tmp_path) == ["a.zarr.zip"]
