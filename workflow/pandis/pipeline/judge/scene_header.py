"""The C header of a scene: its files, the poses of its objects, their materials and textures."""

from pandis.runtime.contact.surfaces import texture_for


def scene_header(name, objects, radius):
    """Return the C header of a scene.

    Parameters
    ----------
    name : str
    objects : list of pandis.pipeline.run.records.scene.PlacedRecord
    radius : float
        Radius of the probe, m.
    """
    prefix = name.replace("-", "_")
    upper, count = prefix.upper(), range(len(objects))
    files = list(dict.fromkeys(file for o in objects for file in (o.file, o.beside_file) if file))
    listed = ",\n".join(f'    "{path}"' for path in files)
    placed = "\n".join(_placed(prefix, files, each) for each in objects)
    materials = "".join(_materials(f"{prefix}_material_{i}", objects[i]) for i in count)
    textures = "".join(_textures(f"{prefix}_texture_{i}", objects[i]) for i in count)
    grain = [f"&{prefix}_texture_{i}" if objects[i].textures else "NULL" for i in count]
    beside = [f"{prefix}_fields + {files.index(o.beside_file)}" if o.beside_file else "NULL"
              for o in objects]  # fmt: skip
    return (
        f"/* The scene {name}, made by pandis: metres and newtons. Open its files in this order\n"
        f" * into {prefix}_fields, then begin a pandis_scene of the {upper}_OBJECTS objects in\n"
        f" * {prefix}_objects (pandis_scene_open).\n"
        f" * For proxies, call {prefix}_touch_open instead of pandis_scene_touch_open. */\n"
        '#include "pandis.h"\n\n'
        f"#define {upper}_FILES {len(files)}\n"
        f"#define {upper}_OBJECTS {len(objects)}\n\n"
        f"static const char *const {prefix}_files[] = {{\n{listed}\n}};\n"
        f"static pandis_field {prefix}_fields[{len(files)}];\n"
        f"static pandis_object {prefix}_objects[] = {{\n{placed}\n}};\n\n"
        "/* per region: static friction, sliding friction, damping, drag */\n"
        f"{materials}"
        + _table("pandis_material *const", f"{prefix}_materials",
                 [f"{prefix}_material_{i}" for i in count])
        + _table("size_t", f"{prefix}_material_counts", [len(o.materials) for o in objects])
        + "/* textures of the surfaces, and the fields that provide a place's material */\n"
        + textures
        + _table("pandis_texture *const", f"{prefix}_textures", grain)
        + _table("pandis_field *const", f"{prefix}_regions", beside)
        + f"\nstatic inline pandis_error {prefix}_touch_open(pandis_scene *scene, "
        "pandis_contact *contacts) {\n"
        f"    pandis_contact_options options[{upper}_OBJECTS];\n"
        f"    for (int i = 0; i < {upper}_OBJECTS; i++) {{\n"
        f"        options[i] = pandis_contact_defaults({prefix}_objects + i);\n"
        f"        options[i].radius = {float(radius)!r};\n"
        f"        options[i].materials = {prefix}_materials[i];\n"
        f"        options[i].material_count = {prefix}_material_counts[i];\n"
        f"        options[i].texture = {prefix}_textures[i];\n"
        f"        options[i].regions = {prefix}_regions[i];\n"
        "    }\n"
        f"    return pandis_scene_touch_open(scene, contacts, options, {upper}_OBJECTS);\n"
        "}\n"
    )  # fmt: skip


def _numbers(values):
    return "{" + ", ".join(repr(float(value)) for value in values) + "}"


def _table(kind, name, entries):
    return f"static const {kind} {name}[] = {{{', '.join(map(str, entries))}}};\n"


def _placed(prefix, files, placed):
    rotation = _numbers(number for row in placed.rotation_matrix for number in row)
    return (
        f"    {{{prefix}_fields + {files.index(placed.file)}, {rotation}, "
        f"{_numbers(placed.translation)}, {placed.scale!r}, {float(placed.stiffness)!r}}}, "
        f"/* {placed.name} */"
    )


def _materials(name, placed):
    rows = [_numbers(material.values()) for material in placed.materials.values()]
    return _table("pandis_material", name, rows)


def _textures(name, placed):
    """Return the C constants of an object's texture; the last one is named ``name``."""
    options = list(placed.textures.values())
    if not options:
        return ""
    texture, single = texture_for(placed.textures, placed.scale), len(options) == 1
    lines, entries = "", []
    for i, each in enumerate(options):
        if each is None:
            entries.append("{NULL, NULL, 0, 0}")
            continue
        part = texture if single else texture.parts[i]
        kind = "ridges" if each.kind == "waves" else "bumps"
        height, length, *direction = part.numbers
        numbers = f"{height!r}, {length!r}" + (f", {_numbers(direction)}" if direction else "")
        lines += f"static const pandis_{kind} {name}_{kind}_{i} = {{{numbers}}};\n"
        entries.append(
            f"{{pandis_{each.kind}, &{name}_{kind}_{i}, {part.most!r}, {part.steepest!r}}}"
        )
    if single:
        return f"{lines}static const pandis_texture {name} = {entries[0]};\n"
    return (
        lines
        + _table("pandis_texture", f"{name}_parts", entries)
        + f"static const pandis_patches {name}_patches = {{{name}_parts, {len(entries)}}};\n"
        f"static const pandis_texture {name} = {{pandis_by_region, &{name}_patches, "
        f"{texture.most!r}, {texture.steepest!r}}};\n"
    )
