"""What a live system sends, kept as it comes: an append-only file that a crash cannot spoil, and a C3D file from it.

The file is a row of blocks: a byte for the kind, the length and the checksum of the body, the body. ``N`` names the
markers of the frames that follow, ``F`` is a frame; before it stands ``S``, its time stamp, where the source does not
count its frames. What a crash cut off is left out when the file is read.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from highfive.mocap_bridge.files.c3d_writer import MAX_POINTS, write_frames
from highfive.mocap_bridge.files.recording import FARTHEST_M
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.wire.lost_samples import lost_before
from highfive.model.errors import HighFiveError
from highfive.model.files import check_size, written_whole
from highfive.model.geometry.rotations import Array

try:
    import fcntl
except ImportError:  # no such locks on this system
    fcntl = None

ENDING = ".part"
"""What the raw file's name has behind that of the C3D file that it is to become."""

AHEAD_S = 5.0
"""A frame number so far ahead of the clock that frames arrive by is not believed, s."""

CLOCKS_DIFFER = 3e-4
"""A rate that is measured to be this close to the nominal one, as a share, is the nominal one."""

_MAGIC = b"HIGHFIVE TAKE 1\n"
LARGEST_TAKE = 1 << 40
"""Bytes: it is read frame by frame, and only has to end."""
_BLOCK = struct.Struct("<cII")
_FRAME = struct.Struct("<qqII")  # number, arrival (ns), markers, points without a label
_STAMP = struct.Struct("<q")  # source time (ns)
_SPARSE, _ALWAYS = 100, 10_000
"""A recording is at most so many times as long as the frames that came and so many more: two hours of which nothing
came. Of a damaged one gaps would be written until the disk is full."""
_MOST_LOOSE = 32  # points without a label that a frame of the C3D file holds
_LONGEST = 1 << 24  # bytes of a block


class NoFrames(HighFiveError):
    """A raw file in which there is no frame."""


class TakeWriter:
    """Appends frames to a raw file. A frame that was added is in the hands of the operating system."""

    def __init__(self, path: Path):
        """Begins a new file at ``path``.

        Raises:
            HighFiveError: it is there already, or cannot be written.
        """
        self.path, self.frames = path, 0
        self._described: tuple[tuple[str, ...], float] | None = None
        try:
            self._file = path.open("xb", buffering=0)
            if fcntl is not None:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._file.write(_MAGIC)
        except OSError as error:
            raise HighFiveError(f"cannot record to {path}: {error.strerror}") from None

    def add(self, frames: Sequence[MarkerFrame], rate_hz: float) -> None:
        """Appends frames; ``rate_hz`` is the system's own, or 0.

        Raises:
            OSError: the disk is full, or has gone.
        """
        blocks = []
        for frame in frames:
            if self._described != (frame.names, rate_hz):
                self._described = frame.names, rate_hz
                blocks.append(_block(b"N", json.dumps({"rate_hz": rate_hz, "names": frame.names}).encode()))
            with np.errstate(over="ignore"):
                points = np.where(frame.valid[:, None], frame.positions, np.nan).astype("<f4")
                loose = frame.unlabelled[:_MOST_LOOSE].astype("<f4")
            if not frame.counted:
                blocks.append(_block(b"S", _STAMP.pack(frame.source_time_ns)))
            head = _FRAME.pack(frame.number, frame.arrival_time_ns, len(points), len(loose))
            blocks.append(_block(b"F", head + points.tobytes() + loose.tobytes()))
        data = memoryview(b"".join(blocks))
        while data:
            data = data[self._file.write(data) :]
        self.frames += len(frames)

    def close(self) -> None:
        """Closes the file; a second call does nothing."""
        self._file.close()


def _block(kind: bytes, body: bytes) -> bytes:
    return _BLOCK.pack(kind, len(body), zlib.crc32(body)) + body


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a frame lies in the raw file, under which names, and when it was stamped, if it was not counted."""

    offset: int
    names: int
    number: int
    arrival_ns: int
    loose: int
    stamp_ns: int | None


def being_written(path: Path) -> bool:
    """Whether another process records to the raw file ``path`` now."""
    if fcntl is None:
        return False
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def take_to_c3d(raw: Path, path: Path, *, replace: bool = False) -> tuple[int, int]:
    """Makes the C3D file ``path`` of a raw file, lost frames as gaps; the raw file stays.

    Markers that were named at any time have a column. Of points without a label the first 32 a frame are kept.

    Returns:
        How many frames the C3D file holds, and how many of them came.

    Raises:
        NoFrames: it holds none.
        HighFiveError: it is no raw file, or the C3D file cannot be written, or is there and may not be replaced.
    """
    try:
        check_size(raw, LARGEST_TAKE)
        with raw.open("rb") as file:
            magic = file.read(len(_MAGIC))
            if magic != _MAGIC and _MAGIC.startswith(magic):  # the disk was full from the first
                raise NoFrames(f"{raw} holds no frame")
            if magic != _MAGIC:
                raise HighFiveError(f"{raw} is no raw recording of High Five")
            tables, rates, places = _index(file)
            if not places:
                raise NoFrames(f"{raw} holds no frame")
            rate = _rate(rates, places)
            if all(place.stamp_ns is not None for place in places):
                rate, slots = _stamped(places, rates, rate)
            else:
                slots = _slots(places, rate)
            names = list(dict.fromkeys(name for table in tables for name in table))[:MAX_POINTS]
            loose = min(max(place.loose for place in places), MAX_POINTS - len(names))
            columns = {name: m for m, name in enumerate(names)}
            tables_to = [np.array([columns.get(name, -1) for name in table], dtype=np.intp) for table in tables]
            labels = [*names, *(f"*{u + 1}" for u in range(loose))]
            order = sorted(range(len(places)), key=lambda k: slots[k])
            total = slots[order[-1]] + 1
            if total > _SPARSE * (len(places) + _ALWAYS):
                raise HighFiveError(f"{raw}: its {len(places)} frames lie {total} apart; it is damaged")
            frames = _frames(file, places, tables_to, [slots[k] for k in order], order, len(names), loose)
            with written_whole(path, replace=replace) as partial:
                write_frames(partial, rate, labels, total, frames)
    except OSError as error:
        raise HighFiveError(f"cannot write {path}: {error.strerror or error}; what came is in {raw}") from None
    return total, len(set(slots))


def _index(file: BinaryIO) -> tuple[list[tuple[str, ...]], list[float], list[_Place]]:
    """Names and rates that were said, and where every whole frame lies."""
    tables: list[tuple[str, ...]] = []
    rates: list[float] = []
    places: list[_Place] = []
    stamp = None
    while True:
        offset = file.tell()
        head = file.read(_BLOCK.size)
        if len(head) < _BLOCK.size:
            break
        kind, length, checksum = _BLOCK.unpack(head)
        if length > _LONGEST:
            break
        body = file.read(length)
        if len(body) < length or zlib.crc32(body) != checksum:
            break
        try:
            if kind == b"N":
                names, rate = _described(body)
                tables.append(names)
                rates.append(rate)
            elif kind == b"F" and tables:
                number, arrival, count, loose = _FRAME.unpack_from(body)
                if count != len(tables[-1]) or length != _FRAME.size + 12 * (count + loose):
                    break
                places.append(_Place(offset, len(tables) - 1, number, arrival, loose, stamp))
                stamp = None
            elif kind == b"S":
                (stamp,) = _STAMP.unpack(body)
        except (struct.error, ValueError, KeyError, TypeError, OverflowError, RecursionError):  # no block of ours
            break
    return tables, rates, places


def _described(body: bytes) -> tuple[tuple[str, ...], float]:
    """Names and rate.

    Raises:
        ValueError, KeyError, TypeError: it says none.
    """
    said = json.loads(body)
    names, rate = tuple(said["names"]), float(said["rate_hz"])
    if len(set(names)) < len(names) or not all(isinstance(name, str) for name in names) or not math.isfinite(rate):
        raise ValueError("names or a rate that are none")
    return names, rate


def _rate(rates: Sequence[float], places: Sequence[_Place]) -> float:
    """The rate that the system said last, or the one at which numbers advanced."""
    said = [rate for rate in rates if _said(rate)]
    if said:
        return said[-1]
    elapsed = (places[-1].arrival_ns - places[0].arrival_ns) * 1e-9
    counted = places[-1].number - places[0].number
    return float(np.clip(round(counted / elapsed), 1, 10_000)) if elapsed > 0.5 and counted > 0 else 120.0


def _said(rate: float) -> bool:
    """Whether a rate, Hz, is one: some systems say 0, and a damaged take anything."""
    return 1.0 <= rate <= 10_000.0


def _stamped(places: Sequence[_Place], rates: Sequence[float], rate: float) -> tuple[float, list[int]]:
    """The rate, and the place of each frame in time, counted from 0, where frames are stamped but not counted.

    The nominal rate is kept where it is right to what clocks differ by, or over the whole recording to a frame.
    """
    stamps = (1e-9 * ((place.stamp_ns or 0) - (places[0].stamp_ns or 0)) for place in places)
    arrivals = (1e-9 * (place.arrival_ns - places[0].arrival_ns) for place in places)
    lost, period_s = lost_before(stamps, arrivals, rates[-1] if _said(rates[-1]) else 0.0)
    slots = (np.arange(len(places)) + np.cumsum(lost)).tolist()
    if period_s > 0.0 and abs(rate * period_s - 1.0) > max(CLOCKS_DIFFER, 1.0 / (slots[-1] + 1)):
        rate = float(np.clip(round(1.0 / period_s, 3), 1.0, 10_000.0))
    return rate, slots


def _slots(places: Sequence[_Place], rate: float) -> list[int]:
    """The place of each frame in time, counted from 0.

    It follows the frame numbers, for they are what is evenly spaced. Where they go back, or run ahead of the clock, the
    system has begun to count anew, and the time of arrival says how long that took.
    """
    first, slots, newest, base = places[0], [], 0, places[0].number
    for place in places:
        by_clock = (place.arrival_ns - first.arrival_ns) * 1e-9 * rate
        slot = place.number - base
        late = slot <= newest and slot > newest - 11 and slot >= 0  # the network changed the order
        if slots and not late and not newest < slot <= by_clock + AHEAD_S * rate:
            slot = max(newest + 1, round(by_clock))
            base = place.number - slot
        slots.append(slot)
        newest = max(newest, slot)
    return slots


def _frames(
    file: BinaryIO,
    places: Sequence[_Place],
    columns: Sequence[np.ndarray],
    slots: Sequence[int],
    order: Sequence[int],
    markers: int,
    loose: int,
) -> Iterator[tuple[Array, np.ndarray]]:
    """Points (M + U, 3), m, and whether they were seen, for every place in time; gaps where no frame came."""
    nothing = np.zeros((markers + loose, 3)), np.zeros(markers + loose, dtype=bool)
    at = 0
    for slot, k in zip(slots, order, strict=True):
        if slot < at:  # the same frame once more
            continue
        for _ in range(slot - at):
            yield nothing
        place = places[k]
        file.seek(place.offset)
        _, length, _ = _BLOCK.unpack(file.read(_BLOCK.size))
        body = file.read(length)
        _, _, count, many = _FRAME.unpack_from(body)
        with np.errstate(invalid="ignore"):  # bytes can make a number that stands for an error
            stored = np.frombuffer(body, "<f4", offset=_FRAME.size).reshape(count + many, 3).astype(float)
        points = np.full((markers + loose, 3), np.nan)
        to = columns[place.names]
        points[to[to >= 0]] = stored[:count][to >= 0]
        points[markers : markers + min(many, loose)] = stored[count : count + min(many, loose)]
        seen = np.asarray((np.abs(points) <= FARTHEST_M).all(axis=1))  # NaN is not less than anything
        yield np.where(seen[:, None], points, 0.0), seen
        at = slot + 1
