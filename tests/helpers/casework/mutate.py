"""Mutations of mesh files that keep most of their structure, for fuzzing."""

import io
import json
import re
import struct
import zipfile

#: Words that numbers are often mistaken for, and numbers that are seldom tried.
WORDS = (
    "nan", "inf", "-inf", "1.#QNAN", "1.#INF", "-1.#IND", "1,5", "1.234,5", "1.0D+02", "0x10",
    "1_0", "1e400", "1e-400", "1e", ".", "-", "+1", "-0", "0", "1", "-1", "2147483648",
    "4294967296", "99999999999999999999", "1.5", "1e3", "#", "\\", "/", "//", "f", "v", "v 1 2 3",
    "f 1 2 3", "end", "\t", "\x00", "\x0c", "٣", "\ufeff", "",
)  # fmt: skip
_VALUES = (-1, 0, 1, 2, 3, 255, 5121, 5126, 10**9, 2**31, 2**64, 0.5, -1.0, 1e300, None, True,
           False, "", "VEC3", "SCALAR", "x.bin", [], {}, [0], [0.5], {"a": 1})  # fmt: skip


def mutations(data, form, rng, count):
    """Yield mutated copies of a file.

    Parameters
    ----------
    data : bytes
        A file that is right, not packed.
    form : str
        Its ending: obj, off, stl, ply, glb, gltf or 3mf.
    rng : numpy.random.Generator
    count : int

    Yields
    ------
    bytes
    """
    change = {"glb": _glb, "gltf": _gltf, "3mf": _threemf, "ply": _ply}.get(form.lstrip("."))
    if change is None:
        change = _bytes if b"\0" in data else _text
    for _ in range(count):
        changed = data
        for _ in range(1 + int(rng.geometric(0.7) > 1)):
            # now and then the bytes themselves, whatever they mean
            raw = rng.random() < 0.1 or not changed
            changed = _bytes(changed, rng) if raw else change(changed, rng)
        yield changed


def _at(rng, length):
    return int(rng.integers(max(length, 1)))


def _bytes(data, rng):
    """Flip, cut, double or drop bytes, or change a count of four of them."""
    data = bytearray(data)
    at, size = _at(rng, len(data)), 1 + _at(rng, 60)
    match _at(rng, 7):
        case 0 if data:
            data[at] ^= 1 << _at(rng, 8)
        case 1:
            del data[at:]
        case 2:
            data[at:at] = data[at : at + size]
        case 3:
            del data[at : at + size]
        case 4 if len(data) >= 84:
            # the count of a binary STL
            declared = int.from_bytes(data[80:84], "little") + int(rng.integers(-3, 4))
            data[80:84] = (declared % 2**32).to_bytes(4, "little")
        case 5:
            data += bytes(size)
        case _:
            data[at : at + 4] = struct.pack(
                "<f", rng.choice([float("nan"), float("inf"), -1, 1e38])
            )
    return bytes(data)


def _number(word, rng):
    """Return a number near one that is a word."""
    try:
        value = float(word)
    except ValueError:
        return str(rng.choice(WORDS))
    if re.fullmatch(r"-?[0-9]+", word):
        return str(int(word[:18]) + int(rng.choice([-1000, -2, -1, 1, 2, 7, 1000])))
    return f"{value * rng.choice([-1, 0.5, 10, 1e-3]) + rng.normal():.6g}"


def _text(data, rng):
    """Swap, double or drop lines or words, change numbers, or cut."""
    lines = data.decode("utf-8", "surrogateescape").split("\n")
    row, other = _at(rng, len(lines)), _at(rng, len(lines))
    match _at(rng, 13):
        case 0:
            lines[row], lines[other] = lines[other], lines[row]
        case 1:
            lines.insert(other, lines[row])
        case 2:
            del lines[row]
        case 3:
            del lines[row:]
        case 4:
            lines.insert(row, str(rng.choice(WORDS)))
        case 5:
            # the counts of headers are in the first lines
            row = _at(rng, min(len(lines), 10))
            lines[row] = re.sub(r"[0-9]+", lambda match: _number(match[0], rng), lines[row])
        case _:
            lines[row] = " ".join(_words(lines[row].split(" "), rng))
    return "\n".join(lines).encode("utf-8", "surrogateescape")


def _words(words, rng):
    """Return a line's words, one of them swapped, doubled, dropped or changed."""
    at, to = _at(rng, len(words)), _at(rng, len(words))
    match _at(rng, 7):
        case 0:
            words[at], words[to] = words[to], words[at]
        case 1:
            words.insert(to, words[at])
        case 2:
            del words[at]
        case 3 | 4:
            words[at] = _number(words[at], rng)
        case _:
            words[at] = str(rng.choice(WORDS))
    return words


def _ply(data, rng):
    """Mutate the header as text, or a binary body as bytes."""
    if b"format ascii" in data:
        return _text(data, rng)
    head, mark, body = data.partition(b"end_header\n")
    if rng.random() < 0.5:
        return _text(head, rng) + mark + body
    return head + mark + _bytes(body, rng)


def _places(value, found):
    """Collect holder and key of every value of a JSON."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in pairs:
        found.append((value, key))
        if isinstance(inner, dict | list):
            _places(inner, found)
    return found


def _json(text, rng):
    """Drop, double, swap or change values of a JSON."""
    try:
        whole = json.loads(text)
        places = _places(whole, []) if isinstance(whole, dict | list) else []
    except (ValueError, RecursionError):
        return _text(text, rng)
    if not places:
        return _text(text, rng)
    holder, key = places[_at(rng, len(places))]
    other, second = places[_at(rng, len(places))]
    value = holder[key]
    match _at(rng, 6):
        case 0:
            del holder[key]
        case 1 if isinstance(holder, list):
            holder.insert(key, value)
        case 2:
            # as text, lest a value come to hold itself
            copies = json.loads(json.dumps([value, other[second]]))
            holder[key], other[second] = copies[1], copies[0]
        case 3 | 4 if type(value) in (int, float):
            holder[key] = value + int(rng.choice([-4, -1, 1, 2, 4]))
        case _:
            holder[key] = _VALUES[_at(rng, len(_VALUES))]
    return json.dumps(whole).encode()


def _gltf(data, rng):
    return _text(data, rng) if rng.random() < 0.1 else _json(data, rng)


def _glb(data, rng):
    """Mutate the JSON or the binary chunk of a GLB, its lengths right or not."""
    if len(data) < 20 or data[:4] != b"glTF":
        return _bytes(data, rng)
    size = struct.unpack_from("<I", data, 12)[0]
    text, rest = data[20 : 20 + size], data[20 + size :]
    if rng.random() < 0.75:
        text = _gltf(text, rng)
    else:
        rest = rest[:8] + _bytes(rest[8:], rng)
        if len(rest) >= 8:
            rest += bytes(-len(rest) % 4)
            rest = struct.pack("<I", len(rest) - 8) + rest[4:]
    if rng.random() < 0.9:
        text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + rest
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _xml(data, rng):
    """Mutate tags and attributes of an XML, kept in one line each."""
    apart = re.sub(rb">\s*<", b">\n<", data)
    if rng.random() < 0.5:
        return _text(apart, rng)
    values = list(re.finditer(rb'"([^"]*)"', apart))
    if not values:
        return _text(apart, rng)
    one = values[_at(rng, len(values))]
    word = one[1].decode("utf-8", "replace")
    new = _number(word, rng) if rng.random() < 0.5 else str(rng.choice(WORDS))
    if rng.random() < 0.2:
        new = values[_at(rng, len(values))][1].decode("utf-8", "replace")
    new = new.replace("\x00", "").replace("\x0c", "")
    return apart[: one.start(1)] + new.encode() + apart[one.end(1) :]


def _threemf(data, rng):
    """Mutate one part of a package, or drop, double or rename one."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as folder:
            parts = [(name, folder.read(name)) for name in folder.namelist()]
    except (zipfile.BadZipFile, ValueError, OSError, RuntimeError):
        return _bytes(data, rng)
    models = [at for at, (name, _) in enumerate(parts) if name.endswith(".model")]
    at = models[_at(rng, len(models))] if models and rng.random() < 0.85 else _at(rng, len(parts))
    if not parts:
        return _bytes(data, rng)
    name, body = parts[at]
    if rng.random() < 0.92:
        parts[at] = name, _xml(body, rng)
    elif rng.random() < 0.5:
        del parts[at]
    else:
        parts[at] = name + "x", body
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as folder:
        for name, body in parts:
            folder.writestr(zipfile.ZipInfo(name), body)
    return stream.getvalue()
