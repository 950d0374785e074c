"""The interface of pandis.h, as a C programmer meets it: names, ranges, lengths, versions.

What a contact does with its options is in test_contact.py and test_leaving.py.
"""

import ctypes
import pkgutil
import re
import shutil
import subprocess

import numpy as np
import pytest

import pandis
from pandis.base.errors import PandisError
from pandis.engine.layout import compare_layouts
from pandis.runtime.contact import NativeContact, Options, TouchedScene, library
from pandis.runtime.contact.surfaces import Material, Texture
from pandis.runtime.field import NativeField
from pandis.runtime.scene import Placed, placed_object
from support import ROOT

ENGINE = ROOT / "workflow" / "pandis" / "engine"
HEADER = (ENGINE / "pandis.h").read_text()
INTERFACE = HEADER[: HEADER.index("#endif /* PANDIS_H */")]
INVALID, ERROR_COUNT = 2, -16


def declarations():
    """Return the functions of the interface, each with the comment before it."""
    macro = r"(?:#define (?:[^\n]*\\\n)+[^\n]*\n)?"
    pattern = rf"(/\*(?:(?!\*/).)*\*/)\n({macro}(?:PANDIS_API [^;]*;\n)+)"
    for comment, declared in re.findall(pattern, INTERFACE, re.DOTALL):
        for name in re.findall(r"\b(pandis_[a-z_]+)\(", declared):
            yield name, comment


def renamed(language):
    """Return the rows of the table in docs/upgrading.md that says what was called otherwise."""
    text = (ROOT / "docs/upgrading.md").read_text().split(f"## {language}\n")[1].split("\n## ")[0]
    rows = text[text.index("| before | now |") :].splitlines()[2:]
    return [row.strip("|").split("|") for row in rows]


def names(cell):
    return set(re.findall(r"\b(?:pandis|PANDIS)_[A-Za-z_]+", cell))


def test_every_new_name_in_c_is_in_the_header():
    words = set(re.findall(r"\b(?:pandis|PANDIS)_[A-Za-z_]+", INTERFACE))
    rows = renamed("C")
    assert len(rows) > 15
    gone = {"pandis_contact_moved", "pandis_poses_frame", "pandis_query_from"}
    assert set().union(*(names(old) for old, _ in rows)) - words == gone
    assert not set().union(*(names(new) for _, new in rows)) - words


def test_every_new_name_in_python_is_there():
    cells = [cell for _, cell in renamed("Python")]
    full = {name for cell in cells for name in re.findall(r"pandis(?:\.\w+)+", cell)}
    assert len(full) > 12
    for name in full - {"pandis.h"}:
        pkgutil.resolve_name(name)


def test_every_function_has_a_comment():
    listed = dict(declarations())
    functions = set(re.findall(r"PANDIS_API [^(;]*?\b(pandis_[a-z_]+)\(", INTERFACE))
    described_together = {"pandis_waves", "pandis_noise", "pandis_by_region"}  # with their structs
    assert functions - set(listed) - described_together == set()
    assert len(functions) > 35
    for called in ("query", "force", "contact_step", "scene_force", "scene_touch", "poses_step"):
        assert listed[f"pandis_{called}"].startswith("/* [rt]"), called
    for called in ("open_file", "refit_open", "scene_open"):
        assert "[rt]" not in listed[f"pandis_{called}"], called


def test_flags_and_errors_do_not_overlap():
    values = {name: int(value) for name, value in re.findall(r"(PANDIS_[A-Z_]+) = (-?\d+)", HEADER)}
    errors = {value for name, value in values.items() if name.startswith("PANDIS_ERROR")}
    assert errors == set(range(-17, 0))
    flags = [values[f"PANDIS_{flag}"] for flag in ("OK", "BOUND", "INVALID", "CUT", "BEYOND")]
    assert flags == [0, 1, 2, 3, 4]


def compiled(folder, compiler, *flags, source=None, text=""):
    """Compile a program with the header; return it, or what the compiler says against it."""
    if source is None:
        source = folder / "wrong.c"
        head = '#define PANDIS_IMPLEMENTATION\n#include <stdio.h>\n#include "pandis.h"\n'
        source.write_text(f"{head}int main(void) {{ {text} return 0; }}\n")
    command = [compiler, *flags, "-O1", "-I", ENGINE, source, "-o", folder / "main", "-lm"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    return done.stderr if done.returncode else folder / "main"


def test_the_parts_of_the_version_are_those_of_the_library():
    """They said 0.1.0 beside "0.2.0"."""
    parts = re.findall(r"#define PANDIS_VERSION_\w+ (\d+)", HEADER)
    assert ".".join(parts) == pandis.__version__
    assert f'#define PANDIS_VERSION "{pandis.__version__}"' in HEADER


@pytest.mark.slow
def test_versions_and_lengths_are_checked(sanitized):
    assert subprocess.run([sanitized, "api"], check=False).returncode == 0


@pytest.mark.slow
def test_versions_and_lengths_are_checked_in_cpp(tmp_path):
    flags = ["-std=c++11", "-x", "c++", "-Wall", "-Werror"]
    program = compiled(tmp_path, "g++", *flags, source=ROOT / "tests" / "native" / "api.c")
    assert subprocess.run([program], check=False).returncode == 0


@pytest.mark.slow
def test_arguments_out_of_range_are_refused(files, sanitized, tmp_path):
    """Nothing is read through them, and a contact goes on with the next step that is right."""
    words = [files["exact"], files["spline"], files["nearest"], tmp_path]
    done = subprocess.run(
        [sanitized, "refusals", *words], check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, f"check {done.returncode}: {done.stderr}"


@pytest.mark.slow
@pytest.mark.parametrize("compiler", ["g++", "clang++"])
def test_the_warnings_of_other_projects_find_nothing(tmp_path, compiler):
    """They had 400 of these, in C++, for whoever compiles all with them."""
    if not shutil.which(compiler):
        pytest.skip(f"no {compiler} here")
    flags = ["-Wall", "-Wextra", "-Werror", "-Wold-style-cast", "-Wcast-qual", "-Wshadow"]
    flags += ["-Wuseless-cast"] if compiler == "g++" else []
    source = ROOT / "tests" / "native" / "api.c"
    program = compiled(tmp_path, compiler, "-std=c++11", "-x", "c++", *flags, source=source)
    assert program == tmp_path / "main", program


@pytest.mark.slow
def test_a_flag_is_no_error_for_a_compiler(tmp_path):
    wrong = "double p[3], d; pandis_field f; puts(pandis_error_text(pandis_distance(&f, p, &d)));"
    said = compiled(tmp_path, "g++", "-std=c++11", "-x", "c++", text=wrong)
    assert "cannot convert" in said
    said = compiled(tmp_path, "gcc", "-Werror", "-Wenum-conversion", text=wrong)
    assert "enum-conversion" in said


@pytest.mark.parametrize("member", ["radius", "budget", "proxy", "options"])
def test_the_state_of_a_contact_is_opaque(tmp_path, member):
    said = compiled(tmp_path, "gcc", text=f"pandis_contact c; (void)c.{member};")
    assert f"no member named ‘{member}’" in said.replace("'", "’").replace("named ’", "named ‘")


def test_shapes_that_are_too_short_are_refused(files):
    lib = NativeField(files["exact"])._library
    field = NativeField(files["exact"])
    count = lib.pandis_vertex_count(field.address)
    assert lib.pandis_vertex_count(NativeField(files["spline"]).address) == 0
    moving = field.moving()
    shape = np.zeros((count + 1, 3))
    for wrong in (count - 1, count + 1, 0):
        assert lib.pandis_refit(moving.address, shape.ctypes.data, wrong) == ERROR_COUNT
    handover = ctypes.create_string_buffer(lib.runtime_handover_bytes())
    size = lib.pandis_handover_room(field.address)
    room = np.empty(size // 8)
    args = handover, field.address, room.ctypes.data
    assert lib.pandis_handover_open(*args, size - 1) == ERROR_COUNT
    assert lib.pandis_handover_open(*args, size) == 0
    assert lib.pandis_handover_refit(handover, shape.ctypes.data, count + 1) == ERROR_COUNT


def opened(files, kind="exact", **changes):
    """Return the error of a contact's opening with options that differ from the defaults."""
    lib, field = library(), NativeField(files[kind])
    placed = placed_object(Placed(field, np.eye(3), np.zeros(3), 1.0, 400.0))
    options = lib.pandis_contact_defaults(ctypes.byref(placed))
    for name, value in changes.items():
        setattr(options, name, value)
    state = ctypes.create_string_buffer(lib.contact_bytes())
    return lib.pandis_contact_open(state, ctypes.byref(placed), ctypes.byref(options))


@pytest.mark.parametrize("kind", ["exact", "compact", "spline", "network", "tricubic"])
@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({}, 0), ({"budget": 8}, 0), ({"budget": 7}, -15), ({"budget": 0}, -15),
        ({"budget": -1}, -15), ({"slide": 0.0}, 0), ({"slide": -1e-9}, -15),
        ({"slide": np.nan}, -15), ({"slide": np.inf}, -15), ({"radius": -1e-9}, -15),
        ({"radius": np.nan}, -15), ({"radius": np.inf}, -15), ({"material_count": 1}, -15),
    ],
)  # fmt: skip
def test_options_have_ranges(kind, changes, error, files):
    assert opened(files, kind, **changes) == error


@pytest.mark.parametrize("value", [-1e-9, np.nan, np.inf])
@pytest.mark.parametrize("name", ["sticking", "sliding", "damping", "drag"])
def test_materials_have_ranges(name, value, files):
    material = Material(1.0, 0.5, 0.0, 0.0)
    setattr(material, name, value)
    both = (Material * 2)(Material(), material)
    assert opened(files, materials=ctypes.addressof(both), material_count=2) == -15
    assert opened(files, materials=ctypes.addressof(both), material_count=1) == 0


def test_sliding_friction_is_at_most_the_sticking_one(files):
    for sliding, error in ((0.4, 0), (0.5, 0), (0.51, -15)):
        material = Material(0.5, sliding, 0.0, 0.0)
        assert opened(files, materials=ctypes.addressof(material), material_count=1) == error


def test_textures_have_ranges(files):
    for most, steepest, error in (
        (0.1, 15.0, 0), (0.1, 15.1, -15), (-0.1, 1.0, -15), (0.1, -1.0, -15), (np.nan, 1.0, -15),
        (0.1, np.nan, -15),
    ):  # fmt: skip
        grain = Texture.noise(0.1, 1.0)
        grain.most, grain.steepest = most, steepest
        assert opened(files, texture=ctypes.addressof(grain)) == error
    empty = Texture(None, None, 0.1, 1.0)
    assert opened(files, texture=ctypes.addressof(empty)) == -15


def contact_of(files, kind="exact", **more):
    field = NativeField(files[kind])
    placed = Placed(field, np.eye(3), np.zeros(3), 1.0, 400.0)
    return field, placed, NativeContact(placed, **more)


def slide(field):
    """Return positions that come down onto an object, and go along below its surface."""
    side, centre = 1.8 / field.frame.scale, np.array(field.frame.centre)
    above = centre + side * np.array([0.31, 0.17, 0.4])
    answer = field.query(above[None])
    normal = answer.normal[0]
    foot = above - answer.distance[0] * normal
    down = foot + np.linspace(0.3, -0.03, 60)[:, None] * side * normal
    along = side * np.cross(normal, [0.3, 0.9, 0.2])
    return np.concatenate([down, down[-1] + np.linspace(0, 0.1, 60)[:, None] * along])


def test_a_contact_that_was_not_opened_gives_no_force(files):
    field, _, contact = contact_of(files)
    ctypes.memset(contact._state, 0, len(contact._state))
    steps = contact.follow(slide(field))
    assert (steps.flag == INVALID).all()
    assert not steps.force.any()
    assert library().pandis_contact_set(contact._state, ctypes.byref(Options(0, 1, 24))) == -15


def test_a_contact_may_be_copied(files):
    """Two copies that go the same way give the same bytes, whatever the other one does."""
    field, placed, contact = contact_of(files, material=Material(0.4, 0.3, 0.1, 0.1))
    other = NativeContact(placed)
    path = slide(field)
    contact.follow(path[:90])
    other._state[:] = contact._state[:]
    one = contact.follow(path[90:])
    contact.follow(path[::-1])
    two = other.follow(path[90:])
    assert one.force.any()
    for mine, its in zip(one[:-1], two[:-1], strict=True):
        assert mine.tobytes() == its.tobytes()


def test_options_change_between_steps(files):
    field, _, contact = contact_of(files)
    path = slide(field)
    contact.follow(path[:90])
    contact.set(budget=8)
    assert contact.options.budget == 8
    assert contact.follow(path[90:]).queries.max() <= 10
    with pytest.raises(PandisError, match="an option of a contact is beyond its range"):
        contact.set(budget=3)
    assert contact.options.budget == 8


@pytest.mark.parametrize("kind", ["exact", "compact", "spline"])
def test_a_larger_radius_moves_the_walls(kind, files):
    """The air that was free for a point was taken to be free for a ball: it felt no wall at all."""
    field, placed, contact = contact_of(files, kind)
    radius = 0.05 / field.frame.scale
    path, ball = slide(field), NativeContact(placed, radius)
    contact.follow(path[:30])
    contact.set(radius=radius)
    late, whole = contact.follow(path[30:]), ball.follow(path)
    assert whole.force.any()
    assert (
        np.flatnonzero(late.force.any(axis=1))[0] == np.flatnonzero(whole.force[30:].any(axis=1))[0]
    )
    assert late.force[-1] == pytest.approx(whole.force[-1], rel=1e-3)


@pytest.mark.parametrize("bad", [np.nan, -1.0, np.inf])
def test_what_is_beyond_its_range_in_a_step_gives_no_force(bad, files):
    field, placed, contact = contact_of(files, material=Material(0.4, 0.3, 0.1, 0.1))
    path = slide(field)
    contact.follow(path[:90])
    contact.move(placed._replace(stiffness=bad))
    steps = contact.follow(path[90:100])
    assert (steps.flag == INVALID).all()
    assert not steps.force.any()
    contact.move(placed)
    assert contact.follow(path[100:110]).force.any()
    contact.materials[0].damping = bad
    steps = contact.follow(path[110:])
    assert (steps.flag == INVALID).all()
    assert not steps.force.any()


def test_a_contact_is_given_no_grid_of_forces_later(files):
    field, placed, contact = contact_of(files)
    path = slide(field)
    contact.follow(path[:90])
    contact.move(placed._replace(field=NativeField(files["trilinear"])))
    assert (contact.follow(path[90:]).flag == INVALID).all()


def test_an_option_of_one_object_of_a_scene_that_is_refused_leaves_out_that_one(files):
    """Every other object is touched as before."""
    field = NativeField(files["exact"])
    aside = np.array([100.0, 0, 0])
    objects = [Placed(field, np.eye(3), at, 1.0, 400.0) for at in (np.zeros(3), aside)]
    with pytest.raises(PandisError, match="beyond its range"):
        TouchedScene(objects, materials=[None, Material(0.1, 0.2, 0, 0)])
    path = slide(field)
    for offset, touched in ((0.0, True), (aside, False)):
        scene = TouchedScene(objects)
        defaults = scene._touching.pandis_contact_defaults
        options = (Options * 2)(*(defaults(ctypes.byref(o)) for o in scene._placed))
        options[1].budget = 1
        error = scene._touching.pandis_scene_touch_open(scene._scene, scene._contacts, options, 2)
        assert error == -15
        assert scene.follow(path + offset).force.any() == touched


def test_a_layout_that_differs_is_named():
    class Wrong(ctypes.Structure):
        _fields_ = (("sticking", ctypes.c_double), ("sliding", ctypes.c_float))

    with pytest.raises(PandisError, match=r"pandis_material.*in C.*in Python; change both"):
        compare_layouts(library().contact_layout, {"pandis_contact_options": Options,
                                                   "pandis_material": Wrong,
                                                   "pandis_texture": Texture})  # fmt: skip
