"""Cases of binary files, of PLY, and of files whose names say another format."""

import numpy as np

from casework import base
from casework.base import Refuses, binary_stl, box, ply, reads_box
from casework.packages import model, package
from casework.scenes import Scene

_LITTLE, _BIG = "binary_little_endian", "binary_big_endian"


def _stl():
    """Binary STL: its size says how many triangles there are."""
    points, faces = box()
    whole, plain = reads_box(), binary_stl(points, faces)

    def case(name, body, right, *otherwise):
        return f"stl-binary-{name}", {"a.stl": body}, right, *otherwise

    yield case("plain", plain, whole)
    yield case("solid", binary_stl(points, faces, b"solid of a program"), whole)
    yield case("solid-spaces", binary_stl(points, faces, b"solid part".ljust(80)), whole)
    yield case("attributes", plain[:132] + b"\xff\x7f" + plain[134:], whole)
    yield case("cut", plain[: 84 + 50 * 8], Refuses(("12", "8")))
    yield case("cut-within", plain[: 84 + 50 * 8 + 25], Refuses(("12", "8")))
    solid = binary_stl(points, faces, b"solid of a program")
    yield case("solid-cut", solid[: 84 + 50 * 8], Refuses(("12", "8")))
    yield case("more-declared", binary_stl(points, faces, declared=17), Refuses(("17", "12")))
    yield case("fewer-declared", binary_stl(points, faces, declared=7), Refuses(("7", "12")))
    yield case("huge-declared", binary_stl(points, faces, declared=2**32 - 1), Refuses(("12",)))
    yield case("trailing", plain + b"0123456789", Refuses(("12",)), whole)
    yield case("header-alone", plain[:84], Refuses())
    yield case("header-cut", plain[:50], Refuses())
    yield case("none", binary_stl(points, faces[:0]), Refuses())
    for name, value in (("nan", np.nan), ("inf", np.inf)):
        bad = points.copy()
        bad[3, 1] = value
        yield case(name, binary_stl(bad, faces), Refuses())


def _strips():
    """Return a box as a PLY of strips: two of four triangles about its side, and its ends."""
    points, _ = box()
    strips = [0, 4, 1, 5, 3, 7, 2, 6, 0, 4, -1, 0, 1, 2, 3, -1, 4, 6, 5, 7]
    # around the side the strip looks outwards if it begins so
    strips = [2, 6, 3, 7, 1, 5, 0, 4, 2, 6, -1, 0, 2, 1, 3, -1, 4, 5, 6, 7]
    head = f"""ply
format {_LITTLE} 1.0
element vertex 8
property float x
property float y
property float z
element tristrips 1
property list int int vertex_indices
end_header
"""
    body = np.array([len(strips), *strips], "<i4").tobytes()
    return head.encode() + np.asarray(points, "<f4").tobytes() + body


def _ply():
    """PLY: its header's counts, and its forms."""
    points, faces = box()
    whole = reads_box()
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]

    def case(name, body, right, *otherwise, ending="ply"):
        return f"ply-{name}", {f"a.{ending}": body}, right, *otherwise

    text = ply(points, faces)
    for form, short in (("ascii", "text"), (_LITTLE, "little"), (_BIG, "big")):
        data = ply(points, faces, form)
        yield case(f"{short}", data, whole)
        yield case(f"{short}-quads", ply(points, quads, form), whole)
        yield case(f"{short}-packed", base.packed(data), whole, ending="ply.gz")
        yield case(f"{short}-cut", data[:-13], Refuses())
        far = [*faces[:-1], (3, 7, 8)]
        yield case(f"{short}-beyond", ply(points, far, form), Refuses(("8",)))
        yield case(f"{short}-negative", ply(points, [*faces[:-1], (3, 7, -1)], form), Refuses())
        for name, counts in {
            "more-faces": {"polygons": 13}, "fewer-faces": {"polygons": 11},
            "more-vertices": {"vertices": 9}, "fewer-vertices": {"vertices": 7},
        }.items():  # fmt: skip
            yield case(f"{short}-{name}", ply(points, faces, form, **counts), Refuses())
    yield case("windows-lines", text.replace(b"\n", b"\r\n"), whole)
    noted = text.replace(b"element vertex", b"comment element vertex 5\nobj_info a\nelement vertex")
    yield case("comments", noted, whole)
    yield case("other-name", text.replace(b"vertex_indices", b"vertex_index"), whole)
    yield case("stray-line", text.replace(b"element vertex", b"made by x\nelement vertex"), Refuses(
        ("line 3",)), whole)  # fmt: skip
    yield case("no-z", text.replace(b"property float z\n", b""), Refuses())
    yield case("no-end", text.split(b"end_header")[0], Refuses())
    yield case("strips", _strips(), whole)
    head = ply(points, faces, _LITTLE).split(b"end_header\n")[0].replace(b"float", b"double")
    head = head.replace(b"property double x", b"property uchar tag\nproperty double x")
    head += b"element edge 1\nproperty int vertex1\nproperty list uchar short more\nend_header\n"
    body = b"".join(b"\7" + np.asarray(point, "<f8").tobytes() for point in points)
    body += b"".join(b"\3" + np.asarray(face, "<i4").tobytes() for face in faces)
    body += b"\1\0\0\0\2\1\0\2\0"
    yield case("doubles-and-edges", head + body, whole)
    bad = points.copy()
    bad[3, 1] = np.nan
    yield case("little-nan", ply(bad, faces, _LITTLE), Refuses())
    yield case("no-faces", ply(points, [], _LITTLE), Refuses())


def _misnamed():
    """Content of another format than the name says: refused, or read as what it is."""
    points, faces = box()
    whole = reads_box()
    scene = Scene()
    scene.mesh(points, faces)
    glb, gltf = scene.glb(), scene.embedded()
    threemf = package({"/3D/3dmodel.model": model({1: (points, faces)}, [1])})
    html = b"<!DOCTYPE html>\n<html><body><h1>404 not found</h1>\nf 1 2 3\n</body></html>\n"
    pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 12345\n"
    contents = {
        "stl": base.stl(points, faces), "binary-stl": binary_stl(points, faces), "glb": glb,
        "gltf": gltf, "ply": ply(points, faces), "obj": base.obj(points, faces),
        "off": base.off(points, faces), "3mf": threemf,
    }  # fmt: skip
    for name, data in contents.items():
        for ending in ("obj", "stl", "ply", "off", "glb", "gltf", "3mf"):
            if name.removeprefix("binary-") != ending:
                yield f"{name}-named-{ending}", {f"a.{ending}": data}, Refuses(), whole
    for ending in ("obj", "stl", "ply", "off", "glb", "gltf", "3mf"):
        yield f"html-named-{ending}", {f"a.{ending}": html}, Refuses()
        yield f"pointer-named-{ending}", {f"a.{ending}": pointer}, Refuses()
        yield f"nothing-named-{ending}", {f"a.{ending}": b""}, Refuses()
        yield f"zeros-named-{ending}", {f"a.{ending}": bytes(700)}, Refuses()
    zipped = package({"/a.txt": b"hello"})
    yield "zip-named-3mf", {"a.3mf": zipped}, Refuses()
    yield "zip-named-glb", {"a.glb": zipped}, Refuses()
    utf16 = base.obj(points, faces).decode().encode("utf-16")
    yield "utf16-named-obj", {"a.obj": utf16}, Refuses(), whole
    marked = b"\xef\xbb\xbf" + base.obj(points, faces)
    yield "marked-named-obj", {"a.obj": marked}, whole, Refuses()


def entries():
    """Yield name, files and what is right."""
    for part in (_stl, _ply, _misnamed):
        yield from part()
