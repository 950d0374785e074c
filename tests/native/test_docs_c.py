"""The C programs of docs/contact.md and docs/using.md, run as they stand, each with its force."""

import re
import shutil
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest

import pandis
from pandis.pipeline.judge.scene_header import scene_header
from pandis.runtime.field.files import read_contents
from support import ROOT

#: Compiling takes long: `make test-slow`.
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc"),
]

#: A box of 30 x 20 x 12 mm around the origin, of two materials.
BOX = """mtllib none.mtl
v -15 -10 -6\nv 15 -10 -6\nv 15 10 -6\nv -15 10 -6\nv -15 -10 6\nv 15 -10 6\nv 15 10 6\nv -15 10 6
usemtl rubber\nf 5 6 7 8\nusemtl steel
f 1 4 3 2\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8
"""
PRELUDE = """
#define PANDIS_IMPLEMENTATION
#include "pandis.h"
#include <stdio.h>
#include <stdlib.h>

static pandis_field field, compact;
static const double stiffness = 0.4, metres_per_mesh_unit = 0.001;  /* N per mm */
static double position[3] = {1, 2, 5};  /* mm: 1 below the upper face */
static double force[3];
"""


def blocks(page):
    """Return the C blocks of a page."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return re.findall(r"^```c\n(.*?)^```$", text, re.M | re.S)


@pytest.fixture(scope="module")
def box(tmp_path_factory):
    """A folder with the box's exact field, and its compact one, which knows the materials."""
    folder = tmp_path_factory.mktemp("docs")
    (folder / "box.obj").write_text(BOX)
    (folder / "none.mtl").write_text("newmtl rubber\nnewmtl steel\n")
    for kind in ("exact", "compact-16"):
        pandis.field(folder / "box.obj", kind).save(folder / f"{kind}.pandis")
    return folder


def run(folder, body, before=""):
    """Compile a program, run it, and return the numbers that it prints."""
    source = f"""{PRELUDE}{before}
int main(void) {{
    if (pandis_open_file(&field, "exact.pandis")) return 2;
    if (pandis_open_file(&compact, "compact-16.pandis")) return 3;
{body}
    return 0;
}}
"""
    (folder / "program.c").write_text(source)
    command = ["gcc", "-std=c99", "-O0", "-I", str(ROOT / "workflow/pandis/engine"), "program.c",
               "-o", "program", "-lm"]  # fmt: skip
    compiled = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert compiled.returncode == 0, compiled.stderr
    done = subprocess.run(["./program"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0
    return np.array(done.stdout.split(), float)


def printed(what, count=3):
    numbers = ", ".join(f"{what}[{k}]" for k in range(count))
    return f'printf("{"%.9g " * count}", {numbers});\n'


def test_a_force_every_tick(box):
    first = blocks("using.md")[0]
    assert first.startswith('#define PANDIS_IMPLEMENTATION\n#include "pandis.h"\n')
    body = first.partition('#include "pandis.h"\n')[2]
    body = body.replace("results/bunny/export/pandis-exact.pandis", "exact.pandis")
    found = run(box, "{" + body + printed("force") + "}")
    assert found == pytest.approx([0, 0, 0.4], abs=1e-6)


PRESS = """
    for (int tick = 0; tick < 200; tick++) {
        double at[3] = {0.001, 0.002, 0.008 - 1.5e-5 * tick};
        if (tick > 199 - 80) at[2] = 0.008 - 1.5e-5 * 119;
        pandis_contact_step(&contact, &object, at, 0.001, &touch);
    }
"""


def test_a_contact_with_materials_and_texture(box):
    """Smooth, then with the material and the grain of the upper face: rubber, 0.1 mm high."""
    contact, regions, grain, parts = blocks("contact.md")[:4]
    begin = "position[0] = 0.001, position[1] = 0.002, position[2] = 0.008;\n"
    smooth = run(box, begin + contact + PRESS + printed("touch.force"))
    deep = 0.0065 - (0.008 - 1.5e-5 * 119)  # of a ball of half a millimetre
    assert smooth == pytest.approx([0, 0, 400 * deep], abs=1e-3)
    rough = grain + parts + regions  # the contact is opened anew, with all of them
    body = begin + contact + "{\n" + rough + PRESS + printed("touch.force") + "}"
    felt = run(box, body + 'printf("%d ", (int)touch.state);')
    assert abs(felt[2] - smooth[2]) > 1e-3
    assert felt[2] == pytest.approx(smooth[2], abs=400 * 1.1e-4)


def test_an_object_that_changes_its_shape(box):
    """Its vertices rise by 10 mm, and so does the probe."""
    _, refit, handover, *_ = blocks("using.md")
    contents = read_contents(box / "exact.pandis")
    unit = np.frombuffer(contents.sections["VERT"], "<f8").reshape(-1, 3)
    vertices = contents.field.frame.to_mesh(unit) + (0, 0, 10)
    numbers = ", ".join(repr(float(x)) for x in vertices.ravel())
    before = f"static const double vertices[] = {{{numbers}}};\n"
    body = "{" + refit + printed("force") + "}"
    body = "position[2] = 15;\n" + body
    assert run(box, body, before) == pytest.approx([0, 0, 0.4], abs=1e-6)
    shared = f"""
    pandis_object placed = {{&field, {{1, 0, 0, 0, 1, 0, 0, 0, 1}}, {{0, 0, 0}}, 1, 0.4}};
    static double space[PANDIS_SCENE_ROOM(1)];
    pandis_scene scene;
    if (pandis_scene_open(&scene, &placed, 1, space, PANDIS_SCENE_ROOM(1))) return 4;
    pandis_contact contact;
    if (pandis_contact_open(&contact, &placed, NULL)) return 5;
    const size_t object = 0, count = pandis_vertex_count(&field);
    pandis_field moving;
    position[2] = 15;
    {{ {handover}
    pandis_force(&moving, position, stiffness, force);
    {printed("force")} }}
    """
    assert run(box, shared, before) == pytest.approx([0, 0, 0.4], abs=1e-6)


def test_a_scene_its_touches_and_its_poses(box):
    """The box moves by 0.1 m along x and goes on at 0.2 m/s: there the force is, and not before."""
    table, poses = blocks("using.md")[3:5]
    touched = blocks("contact.md")[4]
    placed = SimpleNamespace(
        name="box", file="exact.pandis", beside_file=None, rotation_matrix=np.eye(3),
        translation=(0, 0, 0), scale=0.001, stiffness=400.0, textures={},
        materials={"all": {"static": 0, "sliding": 0, "damping": 0, "drag": 0}},
    )  # fmt: skip
    (box / "table.h").write_text(scene_header("table", [placed], 0.0))
    include, _, opened = table.partition('#include "table.h"\n')
    assert include == ""
    begin = "position[0] = 0.001, position[1] = 0.002, position[2] = 0.005;\n"
    before = '#include "table.h"\n'
    assert run(box, begin + opened + printed("force"), before) == pytest.approx([0, 0, 0.4])
    above = begin + opened + touched.replace("static ", "static ")
    down = """
    for (int tick = 0; tick < 200; tick++) {
        position[2] = tick < 100 ? 0.007 - 2e-5 * tick : 0.005;
        pandis_scene_touch(&scene, position, 0.001, force, touches, 8, &touched);
    }
    """
    above = above.replace("position[2] = 0.005", "position[2] = 0.007")
    assert run(box, above + down + printed("force"), before) == pytest.approx([0, 0, 0.4], abs=1e-3)
    after = "pandis_scene_force(&scene, position, force);\n" + printed("force")
    step = "for (int tick = 0; tick < 200; tick++) pandis_poses_step(&poses, &scene, 0.001);\n"
    moved = begin + opened + poses + step + after + "position[0] += 0.1;\n" + after
    there = run(box, moved, before)
    assert there[:3] == pytest.approx([0, 0, 0])
    assert there[3:] == pytest.approx([0, 0, 0.4], abs=1e-3)
