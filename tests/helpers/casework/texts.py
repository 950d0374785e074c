"""Cases of numbers and indices in text: OBJ, OFF, STL and PLY."""

import numpy as np

from casework import base
from casework.base import Reads, Refuses, box, obj, off, ply, reads_box, stl

#: What no standard calls a number, by name: a message must name the line and the token.
TOKENS = {
    "comma": "1,5",
    "thousands-point": "1,234.5",
    "thousands-comma": "1.234,5",
    "qnan": "1.#QNAN",
    "inf-windows": "1.#INF",
    "ind": "-1.#IND",
    "fortran": "1.0D+02",
    "nan": "nan",
    "inf": "-inf",
    "hexadecimal": "0x10",
    "underscore": "1_000",
    "word": "abc",
    "two-points": "1.2.3",
    "half-exponent": "1e",
    "overflow": "1e999",
}
_WRITERS = {"obj": obj, "off": off, "stl": stl, "ply": ply}


def line(data, part):
    """Return ``line 7`` for the first line that holds a part."""
    rows = data.decode("latin-1").split("\n")
    return f"line {next(at for at, row in enumerate(rows, 1) if part in row)}"


def _tokens():
    """One token that is no number, in the third vertex."""
    for form, write in _WRITERS.items():
        points, faces = box()
        points = points.copy()
        points[2, 1] = 77.125
        for name, token in TOKENS.items():
            data = write(points, faces).replace(b"77.125", token.encode(), 1)
            yield f"{form}-{name}", {f"a.{form}": data}, Refuses((line(data, token), token))
        # everywhere: what reads it as decimals reads it right
        data = write(*box((0.5, 1.5, 2.5), (1.5, 3.5, 5.5))).replace(b".", b",")
        answer = reads_box((0.5, 1.5, 2.5), (1.5, 3.5, 5.5))
        files = {f"a.{form}": data}
        yield f"{form}-commas", files, Refuses((line(data, "0,5"), "0,5")), answer
        data = write(*box()).replace(b" 2", b" 2.0000e+00", 1)
        if form in ("obj", "stl"):
            yield f"{form}-windows-lines", {f"a.{form}": data.replace(b"\n", b"\r\n")}, reads_box()


def _obj():
    """Indices, polygons, and what else an OBJ may hold."""
    points, faces = box()
    head = obj(points, [])
    whole = reads_box()

    def case(name, body, right, *otherwise, ending="obj"):
        body = body if isinstance(body, bytes) else body.encode()
        return f"obj-{name}", {f"a.{ending}": body}, right, *otherwise

    far = box((11.0, 2, 3), (12.0, 4, 6))
    back = "".join("f " + " ".join(str(i - 8) for i in face) + "\n" for face in faces).encode()
    two = base.both(whole, reads_box((11, 2, 3), (12, 4, 6)))
    yield case("relative", head + back, whole)
    yield case("relative-blocks", head + back + obj(far[0], []) + back, two)
    again = obj(points, faces) + obj(far[0], []) + back
    yield case("relative-after-absolute", again, two)
    early = b"f -1 -2 -3\n" + obj(points, faces)
    yield case("relative-too-early", early, Refuses(("line 1", "-1")))
    data = obj(points, faces) + b"f -9 -2 -3\n"
    yield case("relative-too-far", data, Refuses(("line 21", "-9")))
    zero = head + b"".join(b"f %d %d %d\n" % tuple(face) for face in faces)
    yield case("zero-based", zero, Refuses(("line 9", "0")))
    yield case("zero-late", obj(points, faces) + b"f 1 2 0\n", Refuses(("line 21", "0")))
    yield case("beyond", obj(points, faces) + b"f 1 2 9\n", Refuses(("line 21", "9", "8")))
    yield case("beyond-far", obj(points, faces) + b"f 1 2 4294967297\n", Refuses(("line 21",)))
    yield case("index-fraction", obj(points, faces) + b"f 1 2 3.5\n", Refuses(("line 21", "3.5")))
    yield case("index-word", obj(points, faces) + b"f 1 2 x\n", Refuses(("line 21", "x")))
    yield case("two-corners", obj(points, faces) + b"f 1 2\n", Refuses(("line 21",)), whole)
    yield case("two-coordinates", b"v 1 2\n" + obj(points, faces), Refuses(("line 1",)))
    # a face may stand before its vertices, as indices that do not count back are of the whole file
    ahead = obj([], faces) + head
    yield case("faces-first", ahead.lstrip(b"\n"), whole, Refuses())
    quads = "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
    yield case("quads", head + quads.encode(), whole)
    yield case("continued", head + quads.replace(" 6", " \\\n6").encode(), whole)
    yield case("continued-windows", (head + quads.replace(" 6", " \\\n6").encode()).replace(
        b"\n", b"\r\n"), whole)  # fmt: skip
    slashes = quads.replace(" ", "//1 ").replace("f//1", "f").replace("\n", "//1\n")
    yield case("normals", head + b"vn 0 0 1\n" + slashes.encode(), whole)
    slashes = slashes.replace("//1", "/1/1")
    yield case("textures", head + b"vt 0 0\nvn 0 0 1\n" + slashes.encode(), whole)
    colours = head.replace(b"\n", b" 0.5 0.25 1\n") + quads.encode()
    yield case("colours", colours, whole)
    yield case("weights", head.replace(b"\n", b" 1.0\n") + quads.encode(), whole)
    yield case("unused-far", obj([*points, (99, 99, 99)], faces), whole)
    extra = b"# v 9 9 9\no part\ng\ns off\nusemtl a\nl 1 2\np 1\n"
    yield case("other-statements", extra + obj(points, faces), whole)
    yield case("tabs", obj(points, faces).replace(b" ", b"\t"), whole)
    yield case("no-last-newline", obj(points, faces).rstrip(), whole)
    yield case("no-faces", head, Refuses())
    yield case("empty", b"", Refuses())
    yield case("packed", base.packed(obj(points, faces)), whole, ending="obj.gz")
    yield case("packed-cut", base.packed(obj(points, faces))[:-20], Refuses(), ending="obj.gz")
    yield case("packed-not", obj(points, faces), Refuses(), whole, ending="obj.gz")
    ball = base.sphere(2.0, (1, 2, 3))
    yield case("sphere", obj(*ball), base.reads(*ball))
    inside = Reads(4, -1 / 6, (0, 0, 0), (1, 1, 1))
    yield case("inside-out", obj(base.TETRA, base.TETRA_FACES[:, ::-1]), inside)


def _off():
    """Headers and counts of OFF."""
    points, faces = box()
    whole, plain = reads_box(), off(points, faces)

    def case(name, body, right, *otherwise, ending="off"):
        return f"off-{name}", {f"a.{ending}": body}, right, *otherwise

    comment = b"# made\n\nOFF # a kind\n# counts\n8 12 18\n" + plain.split(b"\n", 2)[2]
    yield case("comments", comment, whole)
    yield case("counts-beside", plain.replace(b"OFF\n", b"OFF "), whole)
    yield case("counts-glued", plain.replace(b"OFF\n", b"OFF"), Refuses(), whole)
    rows = plain.decode().split("\n")

    def wider(kind, extra):
        body = [f"{kind}", rows[1], *(row + extra for row in rows[2:10]), *rows[10:]]
        return "\n".join(body).encode()

    yield case("colours", wider("COFF", " 255 0 0 255"), whole)
    yield case("normals", wider("NOFF", " 0 0 1"), whole)
    yield case("textures", wider("STOFF", " 0.5 0.5"), whole)
    yield case("all", wider("STCNOFF", " 0 0 1 1 0 0 1 0.5 0.5"), whole)
    coloured = [*rows[:10], *(row + " 255 0 0" for row in rows[10:22]), ""]
    yield case("face-colours", "\n".join(coloured).encode(), whole)
    yield case("one-word-a-line", plain.replace(b" ", b"\n"), whole)
    yield case("four", wider("4OFF", " 1"), Refuses())
    yield case("binary", b"OFF BINARY\n" + np.array([8, 12, 0], ">i4").tobytes(), Refuses())
    body = plain.rstrip().rsplit(b" ", 1)[0]
    yield case("beyond", body + b" 8\n", Refuses(("line 22", "8")))
    yield case("negative", body + b" -1\n", Refuses(("line 22", "-1")))
    yield case("more-declared", plain.replace(b"8 12 0", b"8 13 0"), Refuses(("13", "12")))
    yield case("fewer-declared", plain.replace(b"8 12 0", b"8 11 0"), Refuses(("11",)))
    yield case("fewer-vertices", plain.replace(b"8 12 0", b"7 12 0"), Refuses())
    yield case("more-vertices", plain.replace(b"8 12 0", b"9 12 0"), Refuses())
    yield case("cut", plain[: len(plain) // 2], Refuses())
    yield case("packed", base.packed(plain), whole, ending="off.gz")


def _stl():
    """STL as text."""
    points, faces = box()
    whole, plain = reads_box(), stl(points, faces)

    def case(name, body, right, *otherwise):
        return f"stl-{name}", {"a.stl": body}, right, *otherwise

    second = stl(*box((11.0, 2, 3), (12.0, 4, 6)))
    two = base.both(whole, reads_box((11, 2, 3), (12, 4, 6)))
    yield case("two-solids", plain + second, two)
    yield case("indented", b"  " + plain.replace(b"\n", b"\n   "), whole)
    yield case("capitals", plain.upper(), whole)
    yield case("named", stl(points, faces, "facet normal vertex 1 2 3"), whole)
    yield case("unnamed", plain.replace(b" part", b""), whole)
    rows = plain.split(b"\n")
    # a file that ends within its text lost the rest of it
    yield case("cut-line", b"\n".join(rows[:40]) + b"\n", Refuses())
    yield case("cut-word", plain[: len(plain) // 2], Refuses())
    yield case("cut-facet", b"\n".join(rows[: 1 + 7 * 6]) + b"\n", Refuses(), Reads(
        6, *base.reads(points, faces[:6])[1:]))  # fmt: skip
    lost = b"\n".join(rows[:4] + rows[5:])
    yield case("two-vertices", lost, Refuses(("line 6",)))
    yield case("four-vertices", b"\n".join(rows[:4] + rows[3:]), Refuses(("line 7",)))
    nameless = plain.replace(b"normal 0 0 0", b"normal nan nan nan", 1)
    yield case("normal-nan", nameless, Refuses(("line 2", "nan")), whole)
    yield case("empty", b"solid part\nendsolid part\n", Refuses())
    yield "stl-packed", {"a.stl.gz": base.packed(plain)}, whole


def entries():
    """Yield name, files and what is right."""
    for part in (_tokens, _obj, _off, _stl):
        yield from part()
