"""How a sound file or message is damaged: by its bytes, its words, its fields, or the members of an archive."""

from __future__ import annotations

import io
import json
import re
import warnings
import zipfile
from collections.abc import Sequence
from functools import cache
from random import Random
from typing import Any

_INTEGERS = (
    0, 1, 2, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**63 - 1, 2**63, 2**64 - 1,
)  # fmt: skip
_FLOATS = (
    bytes.fromhex("0000c07f"), bytes.fromhex("0000a07f"), bytes.fromhex("0000807f"), bytes.fromhex("000080ff"),
    bytes.fromhex("ffff7f7f"), bytes.fromhex("01000000"), bytes.fromhex("000000000000f87f"),
    bytes.fromhex("000000000000f07f"), bytes.fromhex("ffffffffffffef7f"), bytes.fromhex("010000000000f47f"),
)  # fmt: skip
"""Not a number (quiet and signalling), infinity, the largest, the smallest: of 4 and of 8 bytes, little endian."""
NUMBERS = (
    "0", "-1", "1", "nan", "inf", "-inf", "1e308", "-1e308", "1e-320", "1e400", "4294967296", "9223372036854775808",
    "-9223372036854775809", "99999999999999999999999", "9" * 400, "9" * 5000, "0.0", "-0.0", "1e9", "1e-9", "",
)  # fmt: skip
WORDS = (
    "", "\0", "\x1b[31m\x1b]0;x\x07", "a" * 3000, "../../../../etc/passwd", "/etc/passwd", "é", "\u202e", "\ud800",
    "\r", "\u2028", "\x85", "\n", "{", "}", "[", "]", "<", "&x;", '"', "'", ",", ";", "\t", "=", ":", "#", "%s", "%n",
    "$(x)",
)  # fmt: skip
_WORD = re.compile(rb"-?\d[\d.eE+-]*|[A-Za-z_][A-Za-z_0-9]*|[^\sA-Za-z_0-9]")
_LARGEST = 1 << 19
"""Bytes of an input: what grows beyond by repetition is cut."""


def damaged_bytes(rng: Random, content: bytes, others: Sequence[bytes]) -> bytes:
    """One to four places changed, or its end cut off: whatever its format."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        _damage(rng, data, others)
    return bytes(data[:_LARGEST])


def _damage(rng: Random, data: bytearray, others: Sequence[bytes]) -> None:
    at = rng.randrange(len(data) + 1)
    end = min(len(data), at + rng.choice((1, 2, 4, 8, 16, 64, 512, 4096)))
    match rng.randrange(10):
        case 0 if at < len(data):
            data[at] ^= 1 << rng.randrange(8)
        case 1 if at < len(data):
            data[at] = rng.randrange(256)
        case 2 | 3:
            size = rng.choice((1, 2, 4, 8))
            value = rng.choice(_INTEGERS) % (1 << 8 * size)
            data[at : at + size] = value.to_bytes(size, rng.choice(("little", "big")))
        case 4:
            number = rng.choice(_FLOATS)
            data[at : at + len(number)] = number
        case 5:
            del data[at:]
        case 6:
            del data[at:end]
        case 7:
            data[at:at] = bytes(data[at:end]) * rng.choice((1, 1, 2, 10, 300))
        case 8:
            other = rng.choice(others)
            start = rng.randrange(len(other) + 1)
            data[at:end] = other[start : start + rng.randrange(1, 600)]
        case _:
            data[at:at] = rng.randbytes(rng.randrange(1, 20))


def damaged_text(rng: Random, content: bytes, others: Sequence[bytes]) -> bytes:
    """Words, numbers or lines changed, taken out, repeated, or nested; a fifth by bytes."""
    if rng.random() < 0.2:
        return damaged_bytes(rng, content, others)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        content = _reworded(rng, content) if rng.random() < 0.65 else _relined(rng, content, others)
        content = content[:_LARGEST]
    return content


def _reworded(rng: Random, content: bytes) -> bytes:
    """One word, number or sign is another, or there more often."""
    start = rng.randrange(max(1, len(content)))
    found = _WORD.search(content, start) or _WORD.search(content)
    if found is None:
        return content + b"x"
    word, kind = found.group(), rng.randrange(6)
    is_number = word[:1].isdigit() or word[:1] == b"-"
    if kind < 3:
        new = rng.choice(NUMBERS if is_number != (kind == 2) else WORDS).encode("utf-8", "surrogatepass")
    elif kind == 3:
        new = b""
    elif kind == 4:
        new = word * min(rng.choice((2, 3, 50, 3000)), 1 + _LARGEST // len(word))
    else:
        new = rng.choice((b"[", b"{", b"a.", b"(", b"<a>", b'{"a":', b"[[")) * rng.choice((1, 2, 100, 20_000)) + word
    return content[: found.start()] + new + content[found.end() :]


def _relined(rng: Random, content: bytes, others: Sequence[bytes]) -> bytes:
    lines = content.split(b"\n")
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(6):
        case 0:
            del lines[at]
        case 1:
            lines[at:at] = [lines[at]] * min(rng.choice((1, 2, 20, 1000)), 1 + _LARGEST // (1 + len(lines[at])))
        case 2:
            lines[at], lines[to] = lines[to], lines[at]
        case 3:
            lines[at:at] = rng.choice(others).split(b"\n")[: rng.randrange(1, 12)]
        case 4:
            del lines[min(at, to) : max(at, to)]
        case _:
            separator = rng.choice((b"\t", b",", b" "))
            cells = lines[at].split(separator)
            cells[rng.randrange(len(cells)) :] = []
            lines[at] = separator.join(cells)
    return b"\n".join(lines)


ODD: tuple[Any, ...] = (
    None, True, False, -1, 0, 1, 2**31, 2**64, 10**400, 1e308, -1e308, 5e-324, float("nan"), float("inf"), "", "\0",
    "\ud800", "\x1b[31m", "a\nb", "../../x", "a" * 3000, [], {}, [[]], [None], {"a": {}}, [[[[]]]], [1e400], ["a"],
    [1, "a"],
)  # fmt: skip


def odd_json(rng: Random, value: Any) -> Any:
    """A JSON value with one to three of its parts odd, missing, or there more often."""
    for _ in range(rng.choice((1, 1, 2, 3))):
        value = _odd_part(rng, value)
    return value


def _odd_part(rng: Random, value: Any) -> Any:
    if isinstance(value, dict) and value and rng.random() < 0.9:
        changed, name = dict(value), rng.choice([*value])
        kind = rng.randrange(8)
        if kind == 0:
            del changed[name]
        elif kind == 1:
            changed[rng.choice(("more", "", "\ud800", name + "2"))] = changed[name]
        else:
            changed[name] = _odd_part(rng, changed[name])
        return changed
    if isinstance(value, list) and value and rng.random() < 0.8:
        changed, at, kind = list(value), rng.randrange(len(value)), rng.randrange(8)
        if kind == 0:
            del changed[at]
        elif kind == 1:
            changed[at:at] = [changed[at]] * rng.choice((1, 2, 100))
        else:
            changed[at] = _odd_part(rng, changed[at])
        return changed
    return rng.choice(ODD)


def damaged_json(rng: Random, content: bytes, others: Sequence[bytes]) -> bytes:
    """JSON with odd parts, or damaged as text is."""
    if rng.random() < 0.7:
        try:
            return json.dumps(odd_json(rng, json.loads(content))).encode()
        except (ValueError, RecursionError):  # damaged already
            pass
    return damaged_text(rng, content, others)


_TOML = (
    "[]", "{}", "nan", "inf", "-inf", '""', '"a"', '"\\u001b[31m"', '"../../../x"', "true", "false", "-1", "0", "1e400",
    "99999999999999999999999", "9" * 400, "1979-05-27T07:32:00Z", "07:32:00", "1979-05-27", "[[[]]]", "[nan]", '["a"]',
    "{a=1}", "[{a=1}]", "1e308", "-1e308", "0.5", "[0.0, 0.0, 0.0]", '["", ""]', "[" * 3000, '"' + "a" * 3000 + '"',
    "{a.b.c.d.e=1}", "1.5", "2", "1000000000", '"""\na\nb"""', "'\t'", '"\\n"', '"e\\u0301"', "[true]", "[1, 2]",
)  # fmt: skip
_ENTRY = re.compile(rb"=[ \t]*[^\n]*")
_KEY = re.compile(rb"^[ \t]*[A-Za-z_][\w.-]*", re.MULTILINE)


def damaged_toml(rng: Random, content: bytes, others: Sequence[bytes]) -> bytes:
    """TOML with values of other kinds, keys missing, twice or unknown; or damaged as text is."""
    if rng.random() < 0.35:
        return damaged_text(rng, content, others)
    for _ in range(rng.choice((1, 1, 1, 2))):
        entries, keys = list(_ENTRY.finditer(content)), list(_KEY.finditer(content))
        if not entries or not keys:
            return content
        if rng.random() < 0.75:
            found, new = rng.choice(entries), b"= " + rng.choice(_TOML).encode()
        else:
            found = rng.choice(keys)
            new = rng.choice((b"more", b"a" + b".a" * rng.choice((1, 3, 20_000)), b"#", b'""', found.group() + b".x"))
        content = content[: found.start()] + new + content[found.end() :]
    return content


_MEMBERS = ("../../escaped.npy", "/tmp/escaped.npy", "owner.npy", "train_input.npy", "a" * 300 + ".npy", "x", "")
_HEADERS = (
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (9999999999, 9999999999), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
    "{'descr': '<f8', 'fortran_order': True, 'shape': (30000000,), }",
    "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }",
    "{'descr': '<U900000000', 'fortran_order': False, 'shape': (), }",
    "{'descr': '|V2000000000', 'fortran_order': False, 'shape': (3,), }",
    "{'descr': [('a', '<f8'), ('b', '<i4')], 'fortran_order': False, 'shape': (2,), }",
    "{'descr': '<M8[s]', 'fortran_order': False, 'shape': (2,), }",
    "{'descr': '<c16', 'fortran_order': False, 'shape': (2,), }",
    "{'descr': '<i8', 'fortran_order': False, 'shape': (0, 90), }",
    "{'descr': '|b1', 'fortran_order': False, 'shape': (90,), }",
)


def damaged_npz(rng: Random, content: bytes, others: Sequence[bytes]) -> bytes:
    """An archive with other members, names, shapes or types, or one that unpacks to far more; half by bytes."""
    if rng.random() < 0.5:
        return damaged_bytes(rng, content, others)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = [(info.filename, archive.read(info)) for info in archive.infolist()]
    at, kind = rng.randrange(len(members)), rng.randrange(8)
    name, data = members[at]
    packed = rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2))
    if kind == 0:
        members[at] = rng.choice(_MEMBERS), data
    elif kind == 1:
        del members[at]
    elif kind == 2:
        members[at] = name, b"\x93NUMPY\x01\x00" + _header(rng.choice(_HEADERS)) + data[128:]
    elif kind == 3 and rng.random() < 0.02:  # dear: to be read it is unpacked
        return _bomb(name)
    elif kind == 4:
        members.append((name, data))
    elif kind == 5:
        members += [(f"m{n}.npy", data) for n in range(rng.choice((1, 10, 300)))]
    else:
        members[at] = name, damaged_bytes(rng, data, others)
    return _archive(members, packed)


@cache
def _bomb(name: str) -> bytes:
    """A quarter of a gigabyte in a quarter of a megabyte."""
    out, count = io.BytesIO(), 1 << 28
    with (
        zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open(name, "w", force_zip64=True) as member,
    ):
        member.write(
            b"\x93NUMPY\x01\x00" + _header(f"{{'descr': '|u1', 'fortran_order': False, 'shape': ({count},), }}")
        )
        for _ in range(count >> 24):
            member.write(bytes(1 << 24))
    return out.getvalue()


def _archive(members: Sequence[tuple[str, bytes]], packed: int) -> bytes:
    out = io.BytesIO()
    with warnings.catch_warnings(action="ignore"), zipfile.ZipFile(out, "w", packed) as archive:  # of a name twice
        for name, data in members:
            archive.writestr(zipfile.ZipInfo(name), data, packed)
    return out.getvalue()


def _header(text: str) -> bytes:
    padded = text.encode().ljust(117) + b"\n"
    return len(padded).to_bytes(2, "little") + padded


def damaged_safetensors(rng: Random, content: bytes, others: Sequence[bytes]) -> bytes:
    """A model with odd parts in its header or its description, whose length fits; half by bytes."""
    if rng.random() < 0.4:
        return damaged_bytes(rng, content, others)
    size = int.from_bytes(content[:8], "little")
    header: dict[str, Any] = json.loads(content[8 : 8 + size])
    about, body = header.get("__metadata__", {}), content[8 + size :]
    kind = rng.randrange(5)
    if kind < 2 and "model" in about:
        text = damaged_json(rng, about["model"].encode(), [about["model"].encode()]).decode("utf-8", "replace")
        header["__metadata__"] = {**about, "model": text}
    elif kind < 4:
        name = rng.choice([one for one in header if one != "__metadata__"])
        tensor = dict(header[name])
        if rng.random() < 0.5:
            tensor["dtype"] = rng.choice(("F64", "F32", "F16", "BF16", "I64", "U8", "BOOL", "F8_E4M3", "X"))
        shape, (first, last) = list(tensor["shape"]), tensor["data_offsets"]
        whole = max(1, (last - first) // {"F64": 8, "I64": 8, "F32": 4, "I32": 4}.get(tensor["dtype"], 8))
        tensor["shape"] = rng.choice(([whole], [1, whole], [whole, 1], shape[::-1], [], [0], [2**40, 2**40], shape))
        header[name] = tensor
        if rng.random() < 0.2:
            del header[name]
    else:
        header = odd_json(rng, header)
    raw = json.dumps(header).encode()
    return len(raw).to_bytes(8, "little") + raw + body
