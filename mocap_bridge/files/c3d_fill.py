"""A C3D file once more with its gaps filled: everything else in it stays as it is, byte by byte.

Analogue channels, events, model outputs and other people are none of the tracker's business, so the file is not written
anew: only the words of points that were missing are put in. Format: the C3D file format user guide, www.c3d.org (Motion
Lab Systems): a residual of -1 means missing, of 0 made up (interpolated, from a model), above 0 measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.files.c3d import MAX_BYTES, UNITS, Layout, layout_of, point_labels, read_bytes, unit_of
from highfive.model.errors import HighFiveError
from highfive.model.files import write_whole
from highfive.model.geometry.rotations import Array

Words = NDArray[np.float32] | NDArray[np.int16]

_DEC, _MIPS = 85, 86
_LARGEST = 32767  # of a 16-bit coordinate
# A residual of one POINT:SCALE (0.01 to 0.1 mm) and one camera. The guide has the residual in the lower byte and the
# cameras in the upper one, ezc3d the other way round: this is the same both ways.
_MEASURED = 0x0101


def write_filled(source: str | Path, target: str | Path, filled: Mapping[str, tuple[Array, NDArray[np.bool_]]]) -> int:
    """Writes ``source`` to ``target`` with missing points put in; returns how many.

    A point that was measured stays what it was. Where a file tells no residuals (all are 0), measured points of the
    labels ``filled`` get the smallest one that it can hold, so that 0 says which points were put in.

    Args:
        source: a C3D file that :func:`highfive.mocap_bridge.files.c3d.read_c3d` reads.
        target: the file to write; it appears whole or not at all.
        filled: for a label as the file has it the positions (T, 3), m, and where (T,) they may be put in.

    Raises:
        HighFiveError: the source cannot be read or the target cannot be written.
    """
    path = Path(source)
    data = bytearray(read_bytes(path, MAX_BYTES))
    layout = layout_of(bytes(data), path.name)
    labels = point_labels(layout)
    columns = [labels.index(label) for label in filled if label in labels]
    unit = UNITS[unit_of(layout, path.name)]
    words = _words(data, layout)
    put_in = 0
    measured = []
    for column, (points, usable) in zip(columns, (filled[labels[c]] for c in columns), strict=True):
        values = words[:, 4 * column : 4 * column + 4]
        own = values if layout.scale < 0 else values.astype(float)
        missing = (own[:, 3] < 0) | ~np.isfinite(own).all(axis=1) | ~own[:, :3].any(axis=1)
        scaled = points / unit if layout.scale < 0 else np.rint(points / (unit * layout.scale))
        here = missing & usable
        if layout.scale > 0:
            here &= (np.abs(scaled) <= _LARGEST).all(axis=1)
        values[here, :3] = scaled[here]
        values[here, 3] = 0
        put_in += int(here.sum())
        measured.append((column, ~missing))
    if put_in and not any(words[seen, 4 * column + 3].any() for column, seen in measured):
        for column, seen in measured:
            words[seen, 4 * column + 3] = _MEASURED
    if put_in:  # decoding and encoding a file without gaps would be for nothing
        _put_back(data, layout, words)
    _write(Path(target), bytes(data))
    return put_in


def _words(data: bytearray, layout: Layout) -> Words:
    """The point and analogue words (T, W) of the file: single precision numbers or 16-bit integers, ours to change."""
    size = layout.frames * layout.words_a_frame * (4 if layout.scale < 0 else 2)
    raw = bytes(data[layout.start : layout.start + size])
    shape = layout.frames, layout.words_a_frame
    if layout.scale > 0:
        return np.frombuffer(raw, ">i2" if layout.processor == _MIPS else "<i2").astype(np.int16).reshape(shape)
    if layout.processor == _DEC:
        halves = np.frombuffer(raw, "<u2").reshape(-1, 2)[:, ::-1].copy()
        return (halves.view("<f4")[:, 0] / np.float32(4.0)).astype(np.float32).reshape(shape)
    return np.frombuffer(raw, ">f4" if layout.processor == _MIPS else "<f4").astype(np.float32).reshape(shape)


def _put_back(data: bytearray, layout: Layout, words: Words) -> None:
    """The inverse of :func:`_words`."""
    if layout.scale > 0:
        raw = words.astype(">i2" if layout.processor == _MIPS else "<i2").tobytes()
    elif layout.processor == _DEC:
        halves = (words * np.float32(4.0)).astype("<f4").reshape(-1).view("<u2").reshape(-1, 2)[:, ::-1]
        raw = halves.astype("<u2").tobytes()
    else:
        raw = words.astype(">f4" if layout.processor == _MIPS else "<f4").tobytes()
    data[layout.start : layout.start + len(raw)] = raw


def _write(path: Path, content: bytes) -> None:
    try:
        write_whole(path, content)
    except OSError as error:
        raise HighFiveError(f"cannot write {path}: {error.strerror or error}") from None
