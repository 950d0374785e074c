"""Pages to touch objects on: the same bits in WebAssembly, drawn surfaces, a driven pointer."""

import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from test_header import points_for

from browser import Browser
from pandis.__main__ import main
from pandis.bridges.web import MODULE, SOURCE
from pandis.bridges.web.surface import surface_of
from pandis.engine.sources import digest
from pandis.runtime.contact import NativeContact
from pandis.runtime.contact.surfaces import Material
from pandis.runtime.field import NativeField
from pandis.runtime.scene import Placed
from support import ROOT

#: What a page can show: each kind that has a proxy.
KINDS = "exact", "compact", "spline", "tricubic", "trilinear-normal", "network", "gradient", "torus"
MASS, HAND, DAMPING, DT = 0.05, 150.0, 5.0, 1e-3  # of web.c


def test_the_module_is_of_these_sources():
    """Otherwise pages would run another pandis.h than everything else."""
    assert digest(SOURCE).encode() in MODULE.read_bytes(), "run `make wasm`, and commit pandis.wasm"


def test_the_module_can_be_made_again(tmp_path):
    """With the compiler that is there: what it answers is compared below, of the one that ships."""
    if not shutil.which("clang") or not shutil.which("wasm-ld"):
        pytest.skip("no clang with wasm-ld here: apt-get install clang lld")
    done = subprocess.run(
        [sys.executable, ROOT / "docs/tools/wasm.py", tmp_path / "made.wasm"],
        env={"PYTHONPATH": str(ROOT / "workflow"), "PATH": "/usr/bin:/bin"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert digest(SOURCE).encode() in (tmp_path / "made.wasm").read_bytes()


def in_node(file, points, folder):
    """Return distances, normals, flags and what a led probe feels, of pandis.wasm in node."""
    if not shutil.which("node"):
        pytest.skip("no node here")
    asked, told = folder / "points", folder / "answers"
    np.ascontiguousarray(points, "<f8").tofile(asked)
    command = ["node", ROOT / "tests/native/web.mjs", MODULE, file, asked, told]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    count, held = len(points), told.read_bytes()
    parts = np.split(np.frombuffer(held, np.uint8), np.cumsum([8 * count, 24 * count, count]))
    distance, normal, flag, felt = parts
    return (distance.view("<f8"), normal.view("<f8").reshape(-1, 3), flag,
            felt.tobytes() and np.frombuffer(felt.tobytes(), "<f8").reshape(-1, 20))  # fmt: skip


def led(field, points):
    """Do what web.c does to a probe, in Python: rows of numbers as `in_node` returns them."""
    placed = Placed.at(field, 0.1, 400.0)
    # the middle of the frame lies at 0, to the last bit as web.c computes it
    scale = 0.1 / (1.8 / field.frame.scale)
    placed = placed._replace(scale=scale, translation=-scale * np.array(field.frame.centre))
    contact = NativeContact(placed, material=Material(0.3, 0.8 * 0.3, 0, 0))
    probe, velocity, force = np.ones(3), np.zeros(3), np.zeros(3)
    before, rows = np.ones(3), []
    contact_at = NativeContact.follow
    for target in 0.05 * points:
        sizes = []
        for i in range(1, 9):
            hand = before + (target - before) * i / 8
            pull = HAND * (hand - probe) - DAMPING * velocity + force
            velocity = velocity + DT / MASS * pull
            probe = probe + DT * velocity
            touch = contact_at(contact, probe[None], DT)
            force = touch.force[0]
            sizes.append(np.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]))
        before = target
        rows.append([*probe, *touch.proxy[0], *force, *touch.normal[0], *sizes])
    return np.array(rows)


@pytest.mark.parametrize(
    ("name", "count"),
    [(name, 6000) for name in KINDS]
    + [pytest.param(name, 100_000, marks=pytest.mark.full) for name in KINDS],
)
def test_in_webassembly_the_answers_have_the_same_bits(files, name, count, tmp_path):
    """Of queries in the box, around it and where there are none, and of a probe that is led."""
    field = NativeField(files[name])
    points = np.concatenate([points_for(field, count), [[np.nan, 0, 0], [1e200, 0, 0]]])
    points[:100] = np.cumsum(np.random.default_rng(5).normal(0, 0.1, (100, 3)), axis=0)
    distance, normal, flag, felt = in_node(files[name], points, tmp_path)
    wanted = field.query(points)
    assert np.array_equal(distance, wanted.distance, equal_nan=True)
    assert np.array_equal(normal, wanted.normal, equal_nan=True)
    assert np.array_equal(flag, wanted.flag)
    by_hand = led(field, points[:100])
    assert (by_hand[:, -8:] > 0).any()  # it is pressed
    assert np.array_equal(felt, by_hand)


def test_a_damaged_file_is_refused_in_webassembly(files, tmp_path):
    damaged = tmp_path / "damaged.pandis"
    held = bytearray(files["spline"].read_bytes())
    held[len(held) // 2] ^= 1
    damaged.write_bytes(held)
    with pytest.raises(AssertionError, match="damaged"):
        in_node(damaged, np.zeros((1, 3)), tmp_path)


@pytest.mark.parametrize("name", KINDS)
def test_what_is_drawn_is_the_surface(files, name):
    """Closed, turned outward, and where the field's distance is zero."""
    field = NativeField(files[name])
    corners, faces = surface_of(field)
    mesh = trimesh.Trimesh(corners, faces, process=False)
    answer = field.query(field.frame.to_mesh(corners))
    off = np.abs(answer.distance) * field.frame.scale
    assert np.percentile(off[np.isfinite(off)], 90) < 2e-3
    if name in ("exact", "compact"):  # the mesh itself, edges and all
        assert np.abs(off).max() < 1e-6
    else:
        assert len(faces) > 1000
    untrained = "network", "gradient"  # whose zeros go through the sides of the box
    if name not in untrained:
        assert mesh.is_watertight
        assert mesh.volume > 0


def page_of(files, names, folder):
    """Write a page with the command, and return it."""
    page = folder / "touch.html"
    assert main(["view", *(str(files[name]) for name in names), "--output", str(page)]) == 0
    return page


def test_a_page_needs_nothing_else(files, tmp_path, capsys):
    """It names no other file and no address; what cannot be touched is refused with a sentence."""
    text = page_of(files, ["compact", "spline"], tmp_path).read_text()
    assert not re.search(r"(src|href)=|https?://|import\(", text)
    other = tmp_path / "other.html"
    for wrong, why in (("nearest", "cannot be touched"), ("sphere", "another object")):
        given = [str(files["compact"]), str(files[wrong]), "--output", str(other)]
        assert main(["view", *given]) == 3
        assert why in capsys.readouterr().err
        assert not other.exists()
    for wrong in (["--size", "0"], ["--size", "nan"], ["--stiffness", "-1"]):
        assert main(["view", str(files["compact"]), *wrong, "--output", str(other)]) == 3
        assert "on a page" in capsys.readouterr().err
    assert main(["view", str(tmp_path / "none.pandis"), "--output", str(other)]) == 3
    assert "cannot be read" in capsys.readouterr().err


def data(browser, name):
    return browser.value(f"document.querySelector('section.touch').dataset.{name}")


def vector(text):
    return np.array([float(part) for part in text.split(",")])


@pytest.mark.parametrize("name", ["compact", "spline", "exact"])
def test_a_pointer_presses_and_slides_and_does_not_pass_through(files, name, tmp_path):
    """Real pointer events, real time; the distance of the proxy is taken outside of the page."""
    page = page_of(files, [name], tmp_path)
    field = NativeField(files[name])
    metre = 0.1 / (1.8 / field.frame.scale)  # metres per mesh unit

    def outside():
        """Return how far (m) the proxy lies outside, and where."""
        at = vector(data(browser, "proxy"))
        return field.query(at[None] / metre + field.frame.centre).distance[0] * metre, at

    with Browser(tmp_path) as browser:
        browser.open(page)
        browser.until("document.querySelector('section.touch').dataset.ticks > 200")
        box = browser.value(
            "JSON.stringify(document.querySelector('canvas').getBoundingClientRect())"
        )
        left, top, width = (float(v) for v in re.findall(r":(-?[\d.]+)", box)[:3])
        # somewhere on it from where the way to the right is on it, too
        seen = browser.value("""(() => { const page = document.querySelector('section.touch').touch;
            const { width } = page.canvas, d = page.depth;
            const on = (k) => [...Array(70).keys()].every((i) => d[k + i] > -Infinity);
            const all = [...d.keys()].filter((k) => k % 7 == 0 && on(k)), k = all[all.length >> 1];
            return [k % width, Math.floor(k / width)] })()""")
        scale = width / browser.value("document.querySelector('canvas').width")
        x, y = left + seen[0] * scale, top + seen[1] * scale
        browser.pointer("mouseMoved", x, y)
        browser.until("document.querySelector('section.touch').dataset.newtons == 0")
        browser.pointer("mousePressed", x, y, button="left", buttons=1, clickCount=1)
        browser.until("document.querySelector('section.touch').dataset.newtons > 0.3")
        depth, before = outside()
        assert abs(depth) < 1e-4
        deepest = 0.0
        for step in range(60):
            browser.pointer("mouseMoved", x + step, y, button="left", buttons=1)
            deepest = min(deepest, outside()[0])
        browser.until("document.querySelector('section.touch').dataset.state & 1")
        moved = f"Math.hypot(...page.proxy.split(',').map((c, k) => c - {before.tolist()}[k]))"
        browser.until(
            f"((page) => {moved} > 1e-3)(document.querySelector('section.touch').dataset)"
        )
        deepest = min(deepest, outside()[0])
        assert deepest > -1e-4  # however it is pressed, the proxy stays outside
        browser.picture(tmp_path / "touch.png")
        browser.pointer("mouseReleased", x + 60, y, button="left")
        browser.until("document.querySelector('section.touch').dataset.newtons == 0")
        assert browser.said == []
