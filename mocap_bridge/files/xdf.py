"""XDF files, as LabRecorder writes them: streams with their samples, stamps, and how far their clocks are off.

Format: github.com/sccn/xdf/wiki/Specifications (1.0). A file that ends in the middle of a chunk, as of a recorder that
was killed, is read up to there.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from mmap import ACCESS_READ, mmap
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from highfive.model.errors import HighFiveError
from highfive.model.files import check_size
from highfive.model.geometry.rotations import Array

MAGIC = b"XDF:"
HEADER, SAMPLES, CLOCK_OFFSET = 2, 3, 4
_KINDS = {
    "float32": "<f4", "double64": "<f8", "int8": "<i1", "int16": "<i2", "int32": "<i4", "int64": "<i8",
}  # fmt: skip
_MOST_BYTES = 4 << 30
_MOST_HEADER = 4_000_000
_MOST_STREAMS = 10_000
_MOST_CHANNELS = 10_000
# What bytes make that are no stream's: the last one where a chunk ends within a sample.
_DAMAGED = (ValueError, KeyError, OverflowError, RecursionError, struct.error, ElementTree.ParseError, IndexError)
_CLOCK_SET_S = 1.0
"""Offsets that differ by more from one measurement to the next are of a clock that was set."""
_LARGEST_S = 1e15
"""No clock says more: beyond it, sums of times are nothing, or overflow."""
_OUTLYING = 3.0
"""An offset that is so many times the usual distance off the line weighs less (Huber)."""


@dataclass(frozen=True)
class XdfStream:
    """A stream of a file.

    Attributes:
        name, kind: LSL's name and type.
        rate_hz: nominal; 0 where samples come as things happen.
        labels: of the C channels; their numbers where it has none.
        stamps: (T,) s, by the sender's clock.
        texts: T rows of C, where the values are texts; else empty.
        values: (T, C), where they are numbers; else (T, 0).
        offset_times: (P,) s, by the sender's clock, when it was measured how far that is off.
        offsets: (P,) s, the recorder's clock minus the sender's.
    """

    name: str
    kind: str
    rate_hz: float
    labels: tuple[str, ...]
    stamps: Array
    texts: tuple[tuple[str, ...], ...]
    values: Array
    offset_times: Array
    offsets: Array

    def on_recorder_clock(self, times_s: Array) -> Array:
        """(N,) s of the sender's clock by the recorder's: through a line of all measurements since the clock was set.

        Without a measurement both clocks are taken for one.
        """
        if not len(self.offsets):
            return times_s
        found = np.array(times_s, float)
        cuts = [0, *(np.flatnonzero(np.abs(np.diff(self.offsets)) > _CLOCK_SET_S) + 1).tolist(), len(self.offsets)]
        begins = [-np.inf, *(float(self.offset_times[cut]) for cut in cuts[1:-1]), np.inf]
        for place, (first, last) in enumerate(pairwise(cuts)):
            here = (times_s >= begins[place]) & (times_s < begins[place + 1]) & (np.abs(times_s) < _LARGEST_S)
            found[here] += _line(self.offset_times[first:last], self.offsets[first:last], np.asarray(times_s)[here])
        return found


def read_xdf(path: Path) -> list[XdfStream]:
    """All streams of a file, in the order of their headers.

    Raises:
        HighFiveError: it cannot be read, or is no XDF file.
    """
    try:
        check_size(path, _MOST_BYTES)
        with path.open("rb") as file:
            content = memoryview(mmap(file.fileno(), 0, access=ACCESS_READ)) if path.stat().st_size else memoryview(b"")
    except OSError as error:
        raise HighFiveError(f"cannot read {path}: {error.strerror or error}") from None
    if content[: len(MAGIC)] != MAGIC:
        raise HighFiveError(f"{path} is no XDF file: it does not begin with {MAGIC.decode()}")
    found: dict[int, _Stream] = {}
    for tag, chunk in _chunks(content, path):
        if tag not in (HEADER, SAMPLES, CLOCK_OFFSET) or len(chunk) < 4:
            continue
        (number,) = struct.unpack_from("<I", chunk)
        try:
            if tag == HEADER:
                if len(found) == _MOST_STREAMS:
                    raise ValueError(f"more than {_MOST_STREAMS} of them make no sense")
                found.setdefault(number, _Stream(bytes(chunk[4:])))
            elif number in found:
                (found[number].samples if tag == SAMPLES else found[number].offset)(chunk[4:])
        except _DAMAGED as error:
            reason = " ".join(str(error).split())
            raise HighFiveError(f"{path} is damaged, or of another version: stream {number}: {reason}") from None
    return [stream.whole() for stream in found.values()]


class _Stream:
    """One that is being read."""

    def __init__(self, header: bytes) -> None:
        if len(header) > _MOST_HEADER or b"<!DOCTYPE" in header or b"<!ENTITY" in header:
            raise ValueError("its header is none that a recorder writes")
        about = ElementTree.fromstring(header.decode("utf-8", errors="replace"))
        self.name, self.kind = about.findtext("name", ""), about.findtext("type", "")
        self.rate_hz = float(about.findtext("nominal_srate", "0") or 0.0)
        self.count, self.format = int(about.findtext("channel_count", "")), about.findtext("channel_format", "")
        if not 1 <= self.count <= _MOST_CHANNELS:
            raise ValueError(f"it has {self.count} channels")
        if self.format != "string" and self.format not in _KINDS:
            raise ValueError(f"its channels are of format {self.format!r}")
        labels = [channel.findtext("label", "") for channel in about.iterfind("desc/channels/channel")]
        named = len(labels) == self.count and all(labels)
        self.labels = tuple(labels) if named else tuple(str(n + 1) for n in range(self.count))
        self.stamps = array("d")
        self.rows: list[tuple[str, ...]] = []
        self.numbers = bytearray()
        self.measured: list[tuple[float, float]] = []

    def samples(self, chunk: memoryview) -> None:
        count, at = _length(chunk, 0)
        step = 1.0 / self.rate_hz if self.rate_hz > 0.0 else 0.0
        width = 0 if self.format == "string" else self.count * np.dtype(_KINDS[self.format]).itemsize
        for _ in range(count):
            own, at = chunk[at], at + 1
            if own:
                self.stamps.append(struct.unpack_from("<d", chunk, at)[0])
                at += 8
            else:  # the recorder leaves out what follows from the nominal rate
                self.stamps.append((self.stamps[-1] if self.stamps else 0.0) + step)
            if width:
                if at + width > len(chunk):
                    raise ValueError("a chunk ends within a sample")
                self.numbers += chunk[at : at + width]
                at += width
            else:
                row: list[str] = []
                for _ in range(self.count):
                    size, at = _length(chunk, at)
                    row.append(bytes(chunk[at : at + size]).decode("utf-8", errors="replace"))
                    at += size
                self.rows.append(tuple(row))

    def offset(self, chunk: memoryview) -> None:
        at, offset = struct.unpack_from("<dd", chunk)
        if abs(at) < _LARGEST_S and abs(offset) < _LARGEST_S:
            self.measured.append((at, offset))

    def whole(self) -> XdfStream:
        measured = np.array(self.measured, float).reshape(-1, 2)
        values = np.zeros((len(self.stamps), 0))
        if self.numbers:
            with np.errstate(invalid="ignore"):  # bytes can make a number that stands for an error
                values = np.frombuffer(self.numbers, _KINDS[self.format]).reshape(-1, self.count).astype(float)
        return XdfStream(
            self.name, self.kind, self.rate_hz, self.labels, np.array(self.stamps, float), tuple(self.rows), values,
            measured[:, 0], measured[:, 1],
        )  # fmt: skip


def _chunks(view: memoryview, path: Path) -> Iterator[tuple[int, memoryview]]:
    at = len(MAGIC)
    while at < len(view):
        try:
            size, at = _length(view, at)
        except (ValueError, IndexError, struct.error):
            if at == len(MAGIC):
                raise HighFiveError(f"{path} is no XDF file: its first chunk has no length") from None
            return
        if size < 2 or at + size > len(view):
            return  # the recorder was killed
        yield struct.unpack_from("<H", view, at)[0], view[at + 2 : at + size]
        at += size


def _length(view: memoryview, at: int) -> tuple[int, int]:
    """A length of 1, 4 or 8 bytes, and where what it is of begins."""
    wide = view[at]
    if wide == 1:
        return view[at + 1], at + 2
    if wide == 4:
        return struct.unpack_from("<I", view, at + 1)[0], at + 5
    if wide == 8:
        return struct.unpack_from("<Q", view, at + 1)[0], at + 9
    raise ValueError(f"a length of {wide} bytes")


def _line(times: Array, offsets: Array, at: Array) -> Array:
    """Offsets ``at`` times, of a line through those measured at ``times``, in which outliers weigh less."""
    middle = float(times.mean())
    design, weights = np.stack([np.ones(len(times)), times - middle], axis=1), np.ones(len(times))
    if len(times) < 3 or float(np.ptp(times)) <= 0.0:
        return np.full(len(at), float(np.median(offsets)))
    line = np.zeros(2)
    for _ in range(20):
        line, *_ = np.linalg.lstsq(design * weights[:, None], offsets * weights, rcond=None)
        away = np.abs(offsets - design @ line)
        usual = max(1.4826 * float(np.median(away)), 1e-9)
        weights = np.sqrt(np.minimum(1.0, _OUTLYING * usual / np.maximum(away, 1e-12)))
    return line[0] + line[1] * (at - middle)


def named(streams: Sequence[XdfStream], name: str, path: Path) -> XdfStream:
    """The stream of that name that has most samples.

    Raises:
        HighFiveError: there is none.
    """
    there = [stream for stream in streams if stream.name == name]
    if not there:
        known = ", ".join(dict.fromkeys(stream.name for stream in streams)) or "none"
        raise HighFiveError(f"{path} has no stream {name}; there are {known}")
    return max(there, key=lambda stream: len(stream.stamps))
