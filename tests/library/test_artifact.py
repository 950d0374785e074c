import os
import subprocess
import zipfile

import numpy as np
import pytest
import zarr
from hypothesis import given, settings
from hypothesis import strategies as st

from pandis.base.errors import ArtifactError, PandisError
from pandis.base.files import write_atomically
from pandis.pipeline.run.job.artifact import (
    ArtifactWriter,
    read_artifact,
    write_artifact,
)

ARRAYS = {
    "points": np.arange(30, dtype=np.float32).reshape(10, 3),
    "stratum": np.array([1, 2, 3], np.uint8),
    "empty": np.zeros((0, 3)),
    "one": np.array(2.5),
}
ATTRIBUTES = {"frame": {"centre": [0.0, 1.0, 2.0], "scale": np.float64(0.5)}, "n": np.int64(3)}
PROVENANCE = {"stage": "test", "options": {"b": 1, "a": [1.5, None]}}


def write(path, arrays=ARRAYS, **extra):
    write_artifact(path, "samples", arrays, attributes=ATTRIBUTES | extra, provenance=PROVENANCE)
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
    write_artifact(paths[0], "samples", ARRAYS, attributes=ATTRIBUTES, provenance=PROVENANCE)
    write_artifact(
        paths[1], "samples", ARRAYS, attributes=ATTRIBUTES, provenance={"stage": "other"}
    )
    write_artifact(
        paths[2], "samples", ARRAYS, attributes=ATTRIBUTES | {"n": 4}, provenance=PROVENANCE
    )
    first, second, third = (read_artifact(path).digest for path in paths)
    assert first == second != third


def test_every_flipped_bit_is_noticed(tmp_path):
    """Exhaustive over a small file: data, headers, directory, comment, every byte."""
    path = tmp_path / "a.zarr.zip"
    write_artifact(path, "samples", {"one": np.array([1.0, 2.0])}, attributes={}, provenance={})
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


@pytest.mark.parametrize("piece", [1, 7, 1000])
def test_pieces_give_the_bytes_of_the_whole(tmp_path, piece):
    """However the rows come: chunk by chunk, in crumbs, or interleaved with another array's."""
    rng = np.random.default_rng(0)
    arrays = {"a": rng.random((50, 3)), "b": rng.integers(0, 9, (50, 4, 2)).astype(np.uint8)}
    chunks = {"a": (8, 3), "b": (16, 2, 2)}
    whole = tmp_path / "whole.zarr.zip"
    digest = write_artifact(
        whole, "samples", arrays, attributes={"n": 1}, provenance={}, chunks=chunks
    )
    with ArtifactWriter(tmp_path / "parts.zarr.zip", "samples") as writer:
        for name in "ab":
            writer.declare(name, arrays[name].shape, arrays[name].dtype, chunks=chunks[name])
            for start in range(0, 50, piece):
                writer.append(name, arrays[name][start : start + piece])
        assert writer.finish({"n": 1}, {}) == digest
    assert (tmp_path / "parts.zarr.zip").read_bytes() == whole.read_bytes()
    with ArtifactWriter(tmp_path / "woven.zarr.zip", "samples") as writer:
        for name in "ab":
            writer.declare(name, arrays[name].shape, arrays[name].dtype, chunks=chunks[name])
        for start in range(0, 50, piece):
            for name in "ab":
                writer.append(name, arrays[name][start : start + piece])
        assert writer.finish({"n": 1}, {}) == digest
    read = read_artifact(tmp_path / "woven.zarr.zip").arrays
    assert all(np.array_equal(read[name], arrays[name]) for name in "ab")


def test_an_unfinished_artifact_leaves_the_old_one(tmp_path):
    path = write(tmp_path / "a.zarr.zip")
    before = path.read_bytes()
    with ArtifactWriter(path, "samples") as writer:
        writer.declare("a", (10,), np.float32)
        writer.append("a", np.zeros(4))
        with pytest.raises(ValueError, match="a: 0 of 10 rows"):
            writer.finish({}, {})
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["a.zarr.zip"]


@pytest.mark.parametrize("fill", [0.0, np.nan])
def test_chunks_of_fill_are_not_stored(tmp_path, fill):
    values = np.full((64, 64, 64), fill, np.float32)
    values[40:50, 3, 60] = 1.5
    path = tmp_path / "grid.zarr.zip"
    with ArtifactWriter(path, "grid") as writer:
        writer.declare("values", values.shape, values.dtype, chunks=(16, 16, 16), fill=fill)
        writer.append("values", values)
        writer.finish({}, {})
    with zipfile.ZipFile(path) as archive:
        stored = [n for n in archive.namelist() if n.startswith("values/c/")]
    assert stored == ["values/c/2/0/3", "values/c/3/0/3"]
    assert np.array_equal(read_artifact(path).arrays["values"], values, equal_nan=True)


def test_wrong_kind_and_missing(tmp_path):
    path = write(tmp_path / "a.zarr.zip")
    with pytest.raises(ArtifactError, match="its kind is samples, expected mesh"):
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
        write_artifact(
            small_disk / "big.zarr.zip", "samples", {"noise": noise}, attributes={}, provenance={}
        )
    with pytest.raises(PandisError, match="No space"):
        write_atomically(small_disk / "kept.zarr.zip", noise.tobytes())
    assert os.listdir(small_disk) == ["kept.zarr.zip"]
    assert (small_disk / "kept.zarr.zip").read_bytes() == kept


def test_leftover_of_a_killed_writer_is_swept(tmp_path):
    (tmp_path / ".a.zarr.zip.part").write_bytes(b"half")
    write(tmp_path / "a.zarr.zip")
    assert os.listdir(tmp_path) == ["a.zarr.zip"]
