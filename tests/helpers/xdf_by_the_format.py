"""Writes XDF by its specification, chunk by chunk: what a recorder would have written."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Written:
    """A stream: of each sample its stamp (None: left out) and its values, and the measurements of its clock."""

    name: str
    kind: str
    rate_hz: float
    form: str
    samples: Sequence[tuple[float | None, Sequence[float | str]]]
    offsets: Sequence[tuple[float, float]] = ()
    labels: Sequence[str] = ()


def length(size: int) -> bytes:
    return b"\x01" + bytes([size]) if size < 256 else b"\x04" + struct.pack("<I", size)


def chunk(tag: int, content: bytes) -> bytes:
    body = struct.pack("<H", tag) + content
    return length(len(body)) + body


def header(stream: Written, channels: int) -> bytes:
    described = "".join(f"<channel><label>{label}</label></channel>" for label in stream.labels)
    return (
        f'<?xml version="1.0"?><info><name>{stream.name}</name><type>{stream.kind}</type>'
        f"<channel_count>{channels}</channel_count><nominal_srate>{stream.rate_hz}</nominal_srate>"
        f"<channel_format>{stream.form}</channel_format><desc><channels>{described}</channels></desc></info>"
    ).encode()


FORMS = {"float32": "f", "double64": "d", "int16": "h", "int64": "q"}


def sample(stream: Written, stamp: float | None, values: Sequence[float | str]) -> bytes:
    found = b"\x00" if stamp is None else b"\x08" + struct.pack("<d", stamp)
    for value in values:
        if stream.form == "string":
            text = str(value).encode()
            found += length(len(text)) + text
        else:
            found += struct.pack(f"<{FORMS[stream.form]}", value if stream.form[0] in "fd" else int(float(value)))
    return found


def xdf(streams: Sequence[Written], a_chunk: int = 40) -> bytes:
    content = b"XDF:" + chunk(1, b'<?xml version="1.0"?><info><version>1.0</version></info>')
    for number, stream in enumerate(streams, start=1):
        channels = len(stream.samples[0][1]) if stream.samples else max(1, len(stream.labels))
        content += chunk(2, struct.pack("<I", number) + header(stream, channels))
    for number, stream in enumerate(streams, start=1):
        for begin in range(0, len(stream.samples), a_chunk):
            part = stream.samples[begin : begin + a_chunk]
            rows = b"".join(sample(stream, *one) for one in part)
            content += chunk(3, struct.pack("<I", number) + length(len(part)) + rows)
        content += chunk(5, bytes(16))  # a boundary
        for at, offset in stream.offsets:
            content += chunk(4, struct.pack("<Idd", number, at, offset))
        content += chunk(6, struct.pack("<I", number) + b"<info></info>")
    return content


def write_xdf(path: Path, streams: Sequence[Written]) -> Path:
    path.write_bytes(xdf(streams))
    return path
