"""The commands for meshes, as a user types them: exit status, files, messages, and equal bytes."""

import json
import os
import re
import subprocess
import sys
import tempfile

import numpy as np
import pytest
import trimesh
import yaml

from pandis.__main__ import COMMANDS, main
from pandis.commands.options import as_flags
from pandis.pipeline.api.options import FLAT
from pandis.pipeline.api.writing import mesh_bytes
from pandis.pipeline.run.job.artifact import read_artifact
from support import environment, snakemake

FINE, UNFIT, USAGE, REFUSED = range(4)


def box(folder, name="part.ply", top=True):
    """Write a box of 30 x 20 x 12, with or without its top."""
    mesh = trimesh.creation.box((30.0, 20.0, 12.0))
    faces = np.array(mesh.faces)
    if not top:
        faces = faces[mesh.triangles_center[:, 2] < 5.9]
    form = name.rpartition(".")[2]
    (folder / name).write_bytes(mesh_bytes(form, np.array(mesh.vertices), faces))
    return folder / name


def typed(*words):
    """Run a command in this process; return its exit status."""
    try:
        return main([str(word) for word in words])
    except SystemExit as end:
        return end.code


@pytest.fixture(autouse=True)
def inside(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_check_tells_by_its_status_whether_a_mesh_is_valid(tmp_path, capsys):
    assert typed("check", box(tmp_path)) == FINE
    assert "valid; 12 faces" in capsys.readouterr().out
    assert typed("check", box(tmp_path, "cup.ply", top=False)) == UNFIT
    out = capsys.readouterr().out
    assert "not valid" in out
    assert "option: --solid" in out
    assert typed("check", "nowhere.stl") == REFUSED
    assert "there is no file 'nowhere.stl'" in capsys.readouterr().err
    (tmp_path / "text.stl").write_text("solid\nnothing\n")
    assert typed("check", "text.stl") == REFUSED
    assert capsys.readouterr().err.startswith("error: text.stl: ")
    assert typed("check") == USAGE
    assert typed("check", "part.ply", "--weld", "much") == USAGE
    assert "mesh.weld: Input should be a valid number" in capsys.readouterr().err
    assert typed("labels", "part.ply", "--near", "-3") == USAGE
    assert "samples.near" in capsys.readouterr().err
    for wrong, message in (
        ("traim.x=3", "did you mean 'train'"),
        ("mesh=3", "write SECTION.KEY=VALUE"),
        ("kind=exact", "write SECTION.KEY=VALUE"),
        ("meshes.x=1", "there is no section meshes"),
        ("mesh.opne=cap", "mesh.opne: unknown option; did you mean 'open'"),
    ):
        assert typed("field", "part.ply", "--set", wrong) == USAGE
        assert message in capsys.readouterr().err
    assert typed("check", "part.ply", "--seed", "-1") == USAGE
    assert typed("check", "analytic:sphere") == FINE


def test_several_meshes_end_with_a_table_and_the_worst_status(tmp_path, capsys):
    box(tmp_path), box(tmp_path, "cup.ply", top=False)
    typed("check", "part.ply"), typed("check", "cup.ply")
    reports = capsys.readouterr().out.splitlines()
    assert typed("check", "part.ply", "cup.ply", "nowhere.stl") == REFUSED
    rows = capsys.readouterr().out.splitlines()
    assert rows[:-3] == reports
    assert [row.split()[0] for row in rows[-3:]] == ["part.ply", "cup.ply", "nowhere.stl"]
    assert typed("check", "--json", "part.ply", "cup.ply") == UNFIT
    first, second = json.loads(capsys.readouterr().out)
    assert (first["ok"], second["ok"]) == (True, False)
    assert second["option"] == {"solid": "always"}


@pytest.mark.slow
def test_compare_says_which_order_it_takes(tmp_path, capsys):
    box(tmp_path)
    assert typed("field", "part.ply", "--kind", "exact") == FINE
    assert typed("compare", "part.ply", "part.pandis") == USAGE
    words = capsys.readouterr().err.split("type: pandis ")[1].split()
    assert typed(*words) == FINE


@pytest.mark.slow
def test_a_printed_remedy_works(tmp_path, capsys):
    box(tmp_path, "cup.ply", top=False)
    assert typed("repair", "cup.ply") == REFUSED
    error = capsys.readouterr().err
    flags = re.search(r"try again with: (.*)", error)[1].split()
    assert not list(tmp_path.glob("*repaired*"))
    assert typed("repair", "cup.ply", *flags) == FINE
    assert typed("check", "cup.repaired.ply") == FINE


def test_an_existing_file_needs_force_and_a_wrong_name_is_told_at_once(tmp_path, capsys):
    box(tmp_path)
    assert typed("repair", "part.ply", "-o", "out.obj", "--quiet") == FINE
    before = (tmp_path / "out.obj").read_bytes()
    (tmp_path / "out.obj").write_text("mine")
    assert typed("repair", "part.ply", "-o", "out.obj", "--quiet") == REFUSED
    assert "--force" in capsys.readouterr().err
    assert (tmp_path / "out.obj").read_text() == "mine"
    assert typed("repair", "part.ply", "-o", "out.obj", "--quiet", "--force") == FINE
    assert (tmp_path / "out.obj").read_bytes() == before
    for words in (
        ("repair", "part.ply", "-o", "out.step"),
        ("repair", "part.ply", "part.ply", "-o", "out.obj"),
        ("repair", "part.ply", tmp_path / "part.ply"),
        ("labels", "part.ply", "-o", "out.csv"),
        ("field", "part.ply", "-o", "out.stl"),
        ("field", "part.ply", "--budget", "20 bananas"),
    ):
        assert typed(*words) == USAGE
        assert capsys.readouterr().err.startswith("error: ")


@pytest.mark.slow
def test_several_meshes_get_a_file_each(tmp_path, capsys):
    box(tmp_path, "a.ply"), box(tmp_path, "b.stl")
    assert typed("field", "a.ply", "b.stl", "-o", "out/", "--kind", "exact", "--quiet") == FINE
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["a.pandis", "b.pandis"]
    assert typed("labels", "a.ply", "b.stl", "-o", "out", "--near", 100, "--surface", 0,
                 "--volume", 0, "--quiet", "--json") == FINE  # fmt: skip
    rows = json.loads(capsys.readouterr().out.partition("\n[")[2].join(["[", ""]))
    assert [row["points"] for row in rows] == [100, 100]


def test_points_that_nobody_can_hold_are_refused_at_once(tmp_path, capsys):
    box(tmp_path)
    assert typed("labels", "part.ply", "--near", 10**12) == REFUSED
    assert "GB of memory" in capsys.readouterr().err
    assert typed("labels", "part.ply", "--near", 0, "--surface", 0, "--volume", 0) == REFUSED
    assert "no points are wanted" in capsys.readouterr().err


def test_names_keep_all_but_the_ending(tmp_path, capsys):
    box(tmp_path, "part.v1.ply"), box(tmp_path, "part.v2.ply")
    assert typed("field", "part.v1.ply", "part.v2.ply", "--kind", "exact", "--quiet") == FINE
    assert {path.name for path in tmp_path.glob("*.pandis")} == {"part.v1.pandis", "part.v2.pandis"}


def test_a_stopped_command_leaves_nothing(tmp_path, monkeypatch, capsys):
    box(tmp_path), (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))

    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("pandis.pipeline.geometry.strata.Strata.shards", stop)
    assert typed("labels", "part.ply", "--quiet") == 130
    assert "interrupted" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"part.ply", "temporary"}
    assert list((tmp_path / "temporary").iterdir()) == []


def test_a_reader_that_goes_away_is_no_error(tmp_path):
    box(tmp_path)
    program = (
        "import sys; from pandis.__main__ import main; sys.stdin.read()\n"
        "sys.exit(main(['check', 'part.ply']))"
    )
    path = os.pathsep.join(sys.path)
    with subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          env=os.environ | {"PYTHONPATH": path}) as running:  # fmt: skip
        running.stdout.close()
        running.stdin.close()
        error = running.stderr.read().decode()
        assert (running.wait(), error) == (0, "")


@pytest.mark.slow
def test_compare_tells_by_its_status_whether_a_field_is_fit(tmp_path, capsys):
    box(tmp_path)
    assert typed("field", "part.ply", "--quiet") == FINE
    assert typed("compare", "part.pandis", "part.ply", "--quiet", "--probes", 2000) == FINE
    assert "fit for use" in capsys.readouterr().out
    assert typed("field", "part.ply", "-o", "bad.pandis", "--kind", "nearest-8", "--quiet") == FINE
    assert typed("compare", "bad.pandis", "part.ply", "--quiet", "--probes", 2000) == UNFIT
    assert typed("compare", "part.ply", "part.ply") == REFUSED


def test_a_full_disk_says_so_and_leaves_nothing(tmp_path, capsys, monkeypatch):
    box(tmp_path)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pandis.base.files.os.fsync", full)
    # the artifacts in the temporary folder do not fit either
    assert typed("labels", "part.ply", "--near", 100, "--quiet") == REFUSED
    assert "No space left on device; free some space" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["part.ply"]


def test_every_option_of_a_section_is_an_option_of_its_commands(capsys):
    sections = {"repair": ["mesh"], "labels": ["mesh", "samples"],
                "field": ["mesh", "device", "samples", "bake", "export"]}  # fmt: skip
    for command, names in sections.items():
        assert typed(command, "--help") == FINE
        page = capsys.readouterr().out
        for section in names:
            for name in FLAT[section].model_fields:
                assert f"--{name.replace('_', '-')}" in page or name == "auto", name
        assert "examples:\n  pandis " + command in page


def test_help_is_quick_to_load_and_lists_every_command():
    program = (
        "import sys; from pandis.__main__ import main\n"
        "try: main(['--help'])\nexcept SystemExit: pass\n"
        "print(sorted({'numpy', 'pydantic', 'zarr'} & sys.modules.keys()))"
    )
    path = os.pathsep.join(sys.path)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": path}, check=True)  # fmt: skip
    assert done.stdout.endswith("[]\n")
    assert all(f"    {name}" in done.stdout for name in COMMANDS)


def test_options_are_written_as_flags():
    assert as_flags({"open": "cap"}) == "--open cap"
    assert as_flags({"solid": "always"}) == "--solid"
    assert as_flags({"rungs": ["clean", "fill"]}) == "--rungs clean,fill"


# --- the workflow's bytes ---------------------------------------------------------------------

FIELDS = ["exact", "compact-auto", "compact-14", "tricubic-32", "spline-32", "nearest-16"]


#: Six of these shared meshes need repair.
SHARED = [
    "broken/cracked_angleblock_704f.stl", "broken/nonmanifold_vertex_cow_5804f.obj",
    "broken/openscad_nonmanifold_1442f.obj", "broken/selfint_closed_17160f.obj",
    "broken/slivers_offset_4418f.obj", "broken/many_holes_plane_16747f.obj",
    "broken/huge_scale_cray_576f.obj", "broken/trimesh_raises_polygon_bunny.ply",
    "watertight/fandisk_6475v_12946f.obj", "watertight/fertility_4494v_9000f.off",
    "watertight/rockerarm_10044v_20088f.obj", "watertight/tooth_2comp_8768f.obj",
]  # fmt: skip
SAMPLES = {"surface": 200, "near": 300, "volume": 100, "held_out": 0, "offsets": 50}


def command_in(workspace, *words):
    path = {"PYTHONPATH": str(workspace / "workflow")}
    done = subprocess.run([sys.executable, "-m", "pandis", *words], cwd=workspace,
                          env=environment(**path), capture_output=True, text=True,
                          check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr


def equal_to_the_workflow(workspace, name, source, *words, fields):
    """Assert that the commands make the workflow's bytes and rows of one mesh."""
    common = ("--open", "cap", "--seed", "7", "--name", name, "--quiet", "--force")
    for field in fields:
        command_in(workspace, "field", source, "--kind", field, "-o", "made.pandis", *words,
                   *common)  # fmt: skip
        exported = workspace / f"results/{name}/export/{field}.pandis"
        assert (workspace / "made.pandis").read_bytes() == exported.read_bytes(), (name, field)
    stored = read_artifact(workspace / f"results/{name}/samples.zarr.zip")
    law = stored.attributes["law"]
    counts = SAMPLES | {key: law[key] for key in ("shallow", "penetration", "bent", "core", "box")}
    options = [w for key, n in counts.items() for w in (f"--{key.replace('_', '-')}", str(n))]
    command_in(workspace, "labels", source, "-o", "made.npz", *options, *common)
    with np.load(workspace / "made.npz") as labels:
        unit = (labels["points"] - labels["centre"]) * labels["scale"]
        assert unit == pytest.approx(stored.arrays["points"], abs=1e-6)
        assert (labels["stratum"] == stored.arrays["stratum"]).all()
        assert (labels["normal"] == stored.arrays["normal"]).all()
        distance = stored.arrays["distance"].astype(float) / labels["scale"]
        assert (labels["distance"] == distance).all()
    command_in(workspace, "repair", source, "-o", "made.ply", *common)
    mesh_artifact = read_artifact(workspace / f"results/{name}/mesh.zarr.zip")
    made = trimesh.load(workspace / "made.ply", process=False)
    assert (np.asarray(made.vertices) == mesh_artifact.arrays["vertices"]).all()
    assert (np.asarray(made.faces) == mesh_artifact.arrays["faces"]).all()


def build(workspace, config, **meshes):
    common = {"samples": SAMPLES, "mesh": {"open": "cap"}, "seed": 7, "meshes": meshes}
    (workspace / "my.yaml").write_text(yaml.safe_dump(common | config))
    done = snakemake(workspace, "-j2", "exports", "samples", "--configfile", "my.yaml")
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_commands_write_the_bytes_of_the_workflow(workspace):
    box(workspace, "part.stl"), box(workspace, "cup.ply", top=False)
    config = {"fields": FIELDS, "export": {"original_faces": True},
              "bake": {"auto": {"compact": {"bytes": 2000}}}}  # fmt: skip
    few = ["exact", "compact-auto"]  # of a mesh that is repaired
    build(workspace, config, part={"source": "part.stl"}, cup={"source": "cup.ply", "fields": few})
    words = ("--original-faces", "--set", "bake.auto.compact.bytes=2000")
    equal_to_the_workflow(workspace, "part", "part.stl", *words, fields=FIELDS)
    equal_to_the_workflow(workspace, "cup", "cup.ply", *words, fields=few)


@pytest.mark.full
def test_commands_write_the_bytes_of_the_workflow_on_real_meshes(workspace, meshes):
    sources = {f"m{k}": {"source": str(meshes / name)} for k, name in enumerate(SHARED)}
    fields = ["exact", "compact-auto"]
    build(workspace, {"fields": fields}, **sources)
    for name, mesh in sources.items():
        equal_to_the_workflow(workspace, name, mesh["source"], fields=fields)


@pytest.mark.slow
def test_run_writes_a_configuration_and_carries_it_out(workspace):
    box(workspace, "part.stl")
    path = {"PYTHONPATH": str(workspace / "workflow")}
    command = [sys.executable, "-m", "pandis", "run", "part.stl", "--size", "0.05", "--unit", "mm",
               "-n"]  # fmt: skip
    for _ in range(2):  # the second time it is there already
        done = subprocess.run(command, cwd=workspace, env=environment(**path), text=True,
                              capture_output=True, check=False)  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        assert "export_native        2" in done.stdout
    written = yaml.safe_load((workspace / "part.yaml").read_text())
    assert written["device"] == {"size": 0.05, "stiffness": 400}
    assert written["fields"] == ["exact", "compact-auto"]
    assert written["mesh"] == {"unit": "mm"}
    head = (workspace / "part.yaml").read_text().partition("\n")[0]
    edited = yaml.safe_dump(written | {"fields": ["exact"]})
    (workspace / "part.yaml").write_text(f"{head}\n{edited}")
    done = subprocess.run(command, cwd=workspace, env=environment(**path), text=True,
                          capture_output=True, check=False)  # fmt: skip
    assert "part.yaml has been edited and is used as it is; --force writes it anew" in done.stderr
    assert "export_native        1" in done.stdout
    for other in (["--stiffness", "800"], ["--unit", "m"], ["--fields", "exact"]):
        done = subprocess.run([*command, *other], cwd=workspace, env=environment(**path), text=True,
                              capture_output=True, check=False)  # fmt: skip
        assert done.returncode == 3
        assert "part.yaml was edited, and was written for other meshes or options" in done.stderr
    for more in (["--force"], ["--unit", "m"], ["--solid"]):  # what nobody edited is replaced
        done = subprocess.run([*command, *more], cwd=workspace, env=environment(**path), text=True,
                              capture_output=True, check=False)  # fmt: skip
        assert "export_native        2" in done.stdout
        assert "wrote part.yaml" in done.stderr
    written = yaml.safe_load((workspace / "part.yaml").read_text())
    assert written["mesh"] == {"unit": "mm", "solid": "always"}
