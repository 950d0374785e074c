"""Cases of 3MF, and its writer."""

import io
import zipfile

from casework import base
from casework.base import Refuses, box, reads_box

_CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
_PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
_BEAMS = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"
_START = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"


def mesh_xml(points, faces):
    """Return a 3MF's mesh."""
    rows = ["<mesh><vertices>"]
    rows += ['<vertex x="{:.17g}" y="{:.17g}" z="{:.17g}"/>'.format(*point) for point in points]
    rows.append("</vertices><triangles>")
    rows += ['<triangle v1="{}" v2="{}" v3="{}"/>'.format(*face) for face in faces]
    return "".join([*rows, "</triangles></mesh>"])


def component(key, transform="", path=""):
    """Return a 3MF's component, or the inside of an item."""
    words = f'objectid="{key}"'
    words += f' transform="{transform}"' * bool(transform) + f' p:path="{path}"' * bool(path)
    return words


def model(objects, items, head='unit="millimeter"', required="p", spaces=""):
    """Return a 3MF's model part.

    Parameters
    ----------
    objects : dict
        For each id a mesh (points, faces), a list of components, or either and a type.
    items : list
        Ids, or what stands in an item.
    """
    rows = [
        f'<?xml version="1.0" encoding="UTF-8"?>\n<model {head} xmlns="{_CORE}" '
        f'xmlns:p="{_PRODUCTION}" {spaces} requiredextensions="{required}"><resources>'
    ]
    for key, entry in objects.items():
        kind = f' type="{entry[-1]}"' if isinstance(entry[-1], str) and len(entry) == 3 else ""
        if isinstance(entry, list):
            body = "".join(f"<component {each}/>" for each in entry)
            inside = f"<components>{body}</components>"
        else:
            inside = mesh_xml(*entry[:2])
        rows.append(f'<object id="{key}"{kind}>{inside}</object>')
    rows.append("</resources><build>")
    rows += [f"<item {each if isinstance(each, str) else component(each)}/>" for each in items]
    return "".join([*rows, "</build></model>"]).encode()


def package(parts, start="/3D/3dmodel.model"):
    """Return a 3MF's package, the same on every run."""
    relations = "http://schemas.openxmlformats.org/package/2006/relationships"
    types = "http://schemas.openxmlformats.org/package/2006/content-types"
    kind = "application/vnd.ms-package.3dmanufacturing-3dmodel+xml"
    rels = "application/vnd.openxmlformats-package.relationships+xml"
    others = "".join(f'<Relationship Target="{name}" Id="r{at}" Type="{_START}"/>'
                     for at, name in enumerate(parts) if name != start)  # fmt: skip
    whole = {
        "[Content_Types].xml": f'<Types xmlns="{types}"><Default Extension="rels" ContentType='
        f'"{rels}"/><Default Extension="model" ContentType="{kind}"/></Types>',
        "_rels/.rels": f'<Relationships xmlns="{relations}"><Relationship Target="{start}" Id="r" '
        f'Type="{_START}"/></Relationships>',
        "3D/_rels/3dmodel.model.rels": f'<Relationships xmlns="{relations}">{others}'
        "</Relationships>",
    }
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as folder:
        for name, data in {
            **whole,
            **{name.lstrip("/"): each for name, each in parts.items()},
        }.items():
            folder.writestr(zipfile.ZipInfo(name), data)
    return stream.getvalue()


def _threemf():
    """3MF: what is built, of which parts."""
    root, one = "/3D/3dmodel.model", box()
    whole, ball = reads_box(), base.sphere(2.0)
    aside = reads_box((11, 2, 3), (12, 4, 6))
    shift = "1 0 0 0 1 0 0 0 1 10 0 0"

    def case(name, objects, items, right, *otherwise, parts=None, **more):
        data = package({root: model(objects, items, **more), **(parts or {})})
        return f"3mf-{name}", {"a.3mf": data}, right, *otherwise

    yield case("box", {1: one}, [1], whole)
    yield "3mf-packed", {"a.3mf.gz": base.packed(package({root: model({1: one}, [1])}))}, whole
    yield case("item-moved", {1: one}, [component(1, shift)], aside)
    yield case("item-twice", {1: one}, [1, component(1, shift)], base.both(whole, aside))
    # rows: x to 2 y, y to −z, z to −x
    turned = component(1, "0 2 0 0 0 -1 -1 0 0 1 2 3")
    yield case("item-turned", {1: one}, [turned], reads_box((-5, 4, -1), (-2, 6, 1)))
    mirror = component(1, "-1 0 0 0 1 0 0 0 1 0 0 0")
    mirrored = reads_box((-2, 2, 3), (-1, 4, 6))
    yield case("item-mirrored", {1: one}, [mirror], mirrored, Refuses())
    parts = {1: one, 2: [component(1), component(1, shift)]}
    yield case("components", parts, [2], base.both(whole, aside))
    size = "2 0 0 0 2 0 0 0 2 0 0 0"
    nested = {1: one, 2: [component(1, shift)], 3: [component(2, size)]}
    answer = reads_box((23, 6, 10), (25, 10, 16))
    yield case("components-nested", nested, [component(3, "1 0 0 0 1 0 0 0 1 1 2 4")], answer)
    yield case("unbuilt", {1: one, 2: ball}, [1], whole)
    for kind in ("support", "solidsupport"):
        yield case(kind, {1: one, 2: (*ball, kind)}, [1, 2], whole)
    inner = {1: one, 2: (*ball, "support"), 3: [component(1), component(2)]}
    yield case("support-within", inner, [3], whole)
    yield case("support-alone", {1: (*one, "support")}, [1], Refuses(("support",)))
    # items must not build what is of no use to a printer
    yield case("other", {1: one, 2: (*ball, "other")}, [1, 2], whole, Refuses(("other",)))
    yield case("surface", {1: (*one, "surface")}, [1], whole, Refuses(("surface",)))
    yield case("type-unknown", {1: (*one, "ghost")}, [1], Refuses(("ghost",)), whole)
    for unit in ("micron", "centimeter", "inch", "foot", "meter"):
        yield case(f"unit-{unit}", {1: one}, [1], whole, head=f'unit="{unit}"')
    yield case("unit-none", {1: one}, [1], whole, head="")
    yield case("unit-unknown", {1: one}, [1], Refuses(("parsec",)), head='unit="parsec"')
    yield case("object-missing", {1: one}, [1, 5], Refuses(("5",)))
    missing = {1: one, 2: [component(1), component(6)]}
    yield case("component-missing", missing, [2], Refuses(("6",)))
    yield case("cycle-1", {1: one, 2: [component(1), component(2)]}, [2], Refuses())
    cycle = {1: one, 2: [component(3)], 3: [component(2), component(1)]}
    yield case("cycle-2", cycle, [2], Refuses())
    cycle = {1: one, 2: [component(3)], 3: [component(4)], 4: [component(2)]}
    yield case("cycle-3", cycle, [1, 2], Refuses())
    yield case("nothing-built", {1: one}, [], Refuses())
    far = one[0], [*one[1][:-1], (3, 7, 8)]
    yield case("index-beyond", {1: far}, [1], Refuses(("8",)))
    for token in ("1,5", "1.#QNAN", "nan"):
        data = model({1: one}, [1]).replace(b'x="1"', f'x="{token}"'.encode(), 1)
        yield f"3mf-{token}", {"a.3mf": package({root: data})}, Refuses((token,))
    short = component(1, "1 0 0 0 1 0 0 0 1")
    yield case("transform-short", {1: one}, [short], Refuses())
    data = model({1: one}, [1]).replace(b"</resources>", b'<object id="1"/></resources>')
    yield "3mf-two-of-an-id", {"a.3mf": package({root: data})}, Refuses(("1",)), whole
    beams = f'xmlns:b="{_BEAMS}"'
    yield case("beams-required", {1: one}, [1], Refuses(("beamlattice",)), required="p b",
               spaces=beams)  # fmt: skip
    yield case("beams-named", {1: one}, [1], whole, spaces=beams)
    for name, space in {
        "slice": "http://schemas.microsoft.com/3dmanufacturing/slice/2015/07",
        "volumetric": "http://schemas.3mf.io/3dmanufacturing/volumetric/2022/01",
    }.items():
        yield case(f"{name}-required", {1: one}, [1], Refuses((name,)), required="p b",
                   spaces=f'xmlns:b="{space}"')  # fmt: skip
    yield case("prefix-unknown", {1: one}, [1], Refuses(("zz",)), required="p zz")
    # production: ids are of their part alone
    a, b = "/3D/Objects/a.model", "/3D/Objects/b.model"
    two = {a: model({1: one}, []), b: model({1: box((11.0, 2, 3), (12.0, 4, 6))}, [])}
    held = {1: [component(1, path=a), component(1, path=b)]}
    yield case("same-id", held, [1], base.both(whole, aside), parts=two)
    straight = [component(1, path=a), component(1, path=b)]
    yield case("same-id-items", {}, straight, base.both(whole, aside), parts=two)
    yield case("same-id-root", {1: one}, [1, component(1, path=b)], base.both(whole, aside),
               parts=two)  # fmt: skip
    yield case("part-missing", {1: [component(1, path="/3D/gone.model")]}, [1], Refuses(
        ("gone.model",)))  # fmt: skip
    yield case("part-id-missing", {2: [component(9, path=a)]}, [2], Refuses(("9",)), parts=two)
    plain = package({root: model({1: one}, [1])})
    yield "3mf-cut", {"a.3mf": plain[: len(plain) // 2]}, Refuses()
    yield "3mf-xml-cut", {"a.3mf": package({root: model({1: one}, [1])[:-40]})}, Refuses()
    moved = package({"/3D/other.model": model({1: one}, [1])}, "/3D/other.model")
    yield "3mf-other-name", {"a.3mf": moved}, whole


def entries():
    """Yield name, files and what is right."""
    yield from _threemf()
