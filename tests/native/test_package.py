"""The package: whoever only asks fields needs NumPy, and no compiler."""

import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from pandis.__main__ import main
from pandis.bridges import mujoco as plugin
from pandis.engine import prebuilt
from pandis.engine.compiler import FLAGS, find_compiler
from pandis.runtime.contact import NativeContact
from pandis.runtime.field import NativeField
from pandis.runtime.scene import NativeScene, Placed
from support import results

ROOT = Path(__file__).resolve().parents[2]
#: In the box of a field, and so much of a scene around an object of 10 cm.
POINTS, AROUND = np.random.default_rng(0).uniform(-1, 1, (2000, 3)), 0.06
NAMES = "exact", "compact", "spline", "tricubic", "network", "gradient", "torus"

#: What a user writes, and what the checkout answers; NumPy is all that there is.
PROGRAM = """
import sys
sys.path[:0] = sys.argv[1:3]
import numpy as np
import pandis
points, answers = np.load(sys.argv[3]), {}
for path in sys.argv[5:]:
    field = pandis.load(path)
    placed = pandis.Placed.at(field, 0.1, 400.0)
    answers["field " + path] = field.force(field.frame.to_mesh(points), k=400)
    answers["contact " + path] = pandis.Contact(placed).follow(0.06 * points).force
    answers["scene " + path] = pandis.Scene([placed, placed]).answer(0.06 * points).force
np.savez(sys.argv[4], **answers)
others = {"scipy", "zarr", "pydantic", "trimesh", "igl", "torch", "yaml"} & set(sys.modules)
others |= {name for name in sys.modules if name.startswith("pandis.pipeline")}
libraries = [line.split()[-1] for line in open("/proc/self/maps") if "/built/" in line]
print(sorted(others), *sorted({path.rpartition("/")[2] for path in libraries}))
"""


#: A mesh and a field, of few points.
CONFIG = """
fields: [exact]
samples: {surface: 2000, offsets: 2000, shallow: 2000, penetration: 2000, bent: 1000, core: 500, box: 1000, held_out: 400}
evaluation: {probes: 1000}
stress: {ticks: 2000, loops: 2}
timing: {queries: 100, cold: 0}
hardware: {seconds: 0.2, loaded_seconds: 0.1}
meshes: {ball: {source: "analytic:sphere"}}
"""  # noqa: E501


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """Return the wheel of these sources, and a folder into which it is installed, with NumPy."""
    if find_compiler() is None:
        pytest.skip("no C compiler here")
    folder = tmp_path_factory.mktemp("package")
    source, ignore = folder / "source", shutil.ignore_patterns("__pycache__", "*.egg-info", "built")
    for name in ("workflow", "rules", "scripts", "config"):
        shutil.copytree(ROOT / name, source / name, ignore=ignore)
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    quiet = ["--no-deps", "--no-index"]
    subprocess.run(
        [*pip, "wheel", *quiet, "--no-build-isolation", "-w", folder, source], check=True
    )
    (wheel,) = folder.glob("*.whl")
    subprocess.run([*pip, "install", *quiet, "--target", folder / "installed", wheel], check=True)
    with_numpy = folder / "numpy"
    with_numpy.mkdir()
    site = Path(np.__file__).parents[1]
    for name in ("numpy", "numpy.libs"):
        if (site / name).is_dir():
            (with_numpy / name).symlink_to(site / name)
    return wheel, folder / "installed", with_numpy


def ask(package, files, tmp_path):
    """Run the program where there is no compiler; returns what it says, and its answers."""
    _, installed, with_numpy = package
    np.save(tmp_path / "points.npy", POINTS)
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", PROGRAM, installed, with_numpy,
         tmp_path / "points.npy", tmp_path / "answers.npz", *files],
        env={"PATH": os.devnull, "HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        return done.stderr, None
    return done.stdout.strip(), np.load(tmp_path / "answers.npz")


def test_with_numpy_alone_and_no_compiler_it_answers_as_the_checkout_does(package, files, tmp_path):
    asked = [files[name] for name in NAMES]
    said, answers = ask(package, asked, tmp_path)
    assert answers is not None, said
    assert re.fullmatch(r"\[\] pandis-[\w-]+\.so", said)  # one library, and nothing but NumPy
    assert not (tmp_path / "cache").exists()  # nothing was compiled, nor kept
    for path in asked:
        field = NativeField(path)
        placed = Placed.at(field, 0.1, 400.0)
        wanted = {
            "field": field.force(field.frame.to_mesh(POINTS), k=400),
            "contact": NativeContact(placed).follow(AROUND * POINTS).force,
            "scene": NativeScene([placed, placed]).answer(AROUND * POINTS).force,
        }
        for what, force in wanted.items():
            assert force.any(axis=1).sum() > 20, (path.name, what)
            assert np.array_equal(answers[f"{what} {path}"], force), (path.name, what)


def command(package, home, *arguments):
    """Return what the command of the installed package prints, with NumPy and no compiler."""
    _, installed, with_numpy = package
    program = f"import sys; sys.path[:0] = {[str(installed), str(with_numpy)]}\n"
    program += "from pandis.__main__ import main\nsys.exit(main(sys.argv[1:]))"
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", program, *map(str, arguments)],
        env={"PATH": os.devnull, "HOME": str(home)}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout


def test_the_command_says_what_files_hold_with_numpy_alone(package, files, tmp_path):
    told = command(package, tmp_path, "info", *(files[name] for name in NAMES))
    assert told.count("whole and undamaged") == len(NAMES)


def test_the_command_makes_a_sample_and_a_page_to_touch_it_on(package, tmp_path):
    """The page is the one that a checkout makes."""
    file, pages = tmp_path / "torus.pandis", [tmp_path / f"{k}.html" for k in range(2)]
    command(package, tmp_path, "sample", "torus", file, "3", "1")
    command(package, tmp_path, "view", file, "--output", pages[0])
    assert main(["view", str(file), "--output", str(pages[1])]) == 0
    assert pages[0].read_bytes() == pages[1].read_bytes()


MUJOCO = """
import sys, warnings
warnings.simplefilter("error")
sys.path[:0] = sys.argv[1:4]
import mujoco
model = mujoco.MjModel.from_xml_string(open(sys.argv[4]).read())
data = mujoco.MjData(model)
mujoco.mj_step(model, data, 100)
print(*map(repr, data.qpos.tolist()))
print({line.rpartition("/")[2].strip() for line in open("/proc/self/maps") if "/built/" in line})
"""


def test_mujoco_finds_the_plugin_without_a_compiler(package, files, tmp_path):
    mujoco = pytest.importorskip("mujoco", reason="no MuJoCo here: pip install mujoco-core")
    _, installed, with_numpy = package
    beside = tmp_path / "beside"
    beside.mkdir()
    (beside / "mujoco").symlink_to(Path(mujoco.__file__).parent)
    text = tmp_path / "ball.xml"
    text.write_text(f"""<mujoco><extension><plugin plugin="pandis.sdf"><instance name="b">
        <config key="file" value="{files["compact"]}"/><config key="scale" value="0.05"/>
        </instance></plugin></extension><asset><mesh name="b"><plugin instance="b"/></mesh></asset>
        <worldbody><geom type="sdf" mesh="b"><plugin instance="b"/></geom><body pos="0.2 -0.1 0.08">
        <freejoint/><geom size="0.02"/></body></worldbody></mujoco>""")
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", MUJOCO, installed, with_numpy, beside, text],
        env={"PATH": os.devnull, "HOME": str(tmp_path)}, cwd=tmp_path, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert not done.returncode, done.stderr
    place, libraries = done.stdout.splitlines()
    assert re.fullmatch(r"\{'pandis-mujoco-[\w-]+\.so'\}", libraries)
    plugin.register()
    model = mujoco.MjModel.from_xml_string(text.read_text())
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    assert place.split() == [repr(value) for value in data.qpos.tolist()]


def test_the_wheel_is_small_and_for_all_linux_systems(package):
    wheel, _, _ = package
    assert wheel.stat().st_size <= 1_380_000
    assert re.search(r"-py3-none-manylinux_2_17_\w+\.manylinux2014_\w+\.whl$", wheel.name)
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (metadata,) = (name for name in names if name.endswith("/METADATA"))
        needs = re.findall(r"^Requires-Dist: (.*)$", archive.read(metadata).decode(), re.M)
    assert [need for need in needs if "extra ==" not in need] == ["numpy>=2"]
    assert any("zarr" in need and 'extra == "make"' in need for need in needs)
    assert not any(name.startswith(("build", "tests")) for name in names)


def test_a_checkout_names_its_own_workflow(capsys):
    assert main(["snakefile"]) == 0
    assert capsys.readouterr().out == f"{ROOT / 'workflow/Snakefile'}\n"


@pytest.mark.slow
def test_the_installed_workflow_makes_what_a_checkout_makes(package, tmp_path):
    """Without a checkout: the same bytes, from the Snakefile that the command names."""
    _, installed, _ = package
    (tmp_path / "config").mkdir()
    (tmp_path / "config/config.yaml").write_text(CONFIG)
    snakefile = command(package, tmp_path, "snakefile").strip()
    assert snakefile == str(installed / "pandis/snakemake/workflow/Snakefile")
    made = []
    for path, library in ((snakefile, installed), (ROOT / "workflow/Snakefile", "")):
        shutil.rmtree(tmp_path / "results", ignore_errors=True)
        shell = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
        done = subprocess.run(
            [sys.executable, "-m", "snakemake", "-s", path, "-j2", "all"],
            cwd=tmp_path, env=shell | {"PYTHONPATH": str(library)}, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert (tmp_path / "results/report.html").is_file()
        made.append(results(tmp_path))
    assert made[0] == made[1]
    assert "results/ball/export/exact.pandis" in made[0]


def test_a_library_of_other_sources_is_not_taken(package, files, tmp_path):
    """Without a compiler that is an error that says what to do; with one it is compiled anew."""
    _, installed, with_numpy = package
    changed = tmp_path / "changed"
    shutil.copytree(installed, changed)
    header = changed / "pandis/engine/pandis.h"
    header.write_text(header.read_text() + "/* changed */\n")
    said, answers = ask((None, changed, with_numpy), [files["torus"]], tmp_path)
    assert answers is None
    assert "no C compiler found for field.c: install one" in said


def test_a_checkout_brings_nothing_along():
    assert not prebuilt.FOLDER.exists()
    assert not any(
        prebuilt.find(part, FLAGS) for parts in prebuilt.LIBRARIES.values() for part in parts
    )
