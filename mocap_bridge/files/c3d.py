"""C3D files in and out.

Reading is done here, byte by byte against the length of the file, because ezc3d ends the process with a segmentation
fault on some damaged files (5 of 300 mutations of a real one); its reader is the oracle of this one in the tests.
Writing is ezc3d's. Format: the C3D file format user guide, www.c3d.org (Motion Lab Systems).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

import ezc3d
import numpy as np
from numpy.typing import NDArray

from highfive.mocap_bridge.files.recording import Recording, check_scale
from highfive.model.errors import HighFiveError
from highfive.model.files import written_whole
from highfive.model.geometry.rotations import Array

BLOCK = 512
MAX_BYTES = 1 << 30
"""Largest file that is read, bytes: an hour of two people with 60 markers each is about 0.8 GB."""

UNITS = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_IMPORTED = (".bvh", ".trc", ".csv", ".tsv")  # what ``highfive import`` makes a C3D file of
_INTEL, _DEC, _MIPS = 84, 85, 86
_UNLABELLED = re.compile(r"(\*|uname|unlabel|unidentified).*|", re.IGNORECASE)
# Model outputs that Vicon stores among the points, but that are no positions.
_OUTPUT_GROUPS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")


@dataclass(frozen=True)
class Parameter:
    """One parameter of the file: numbers (float64, flat) or, for text, the strings."""

    numbers: Array
    strings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layout:
    """What header and parameters say of the point data, checked against the size of the file."""

    parameters: dict[tuple[str, str], Parameter]
    processor: int
    rate_hz: float
    scale: float
    points: int
    frames: int
    start: int
    words_a_frame: int


def read_c3d(path: str | Path, max_bytes: int = MAX_BYTES, trust_unit: bool = True) -> Recording:
    """Reads the labelled and unlabelled points of a C3D file, in metres.

    A point is missing where its residual is negative, a coordinate is not finite, or all three are exactly zero.

    Args:
        path: the file.
        max_bytes: larger files are refused.
        trust_unit: refuse sizes that no person has; False leaves it to the caller to find out the unit.

    Raises:
        HighFiveError: no such file, larger than ``max_bytes``, empty, cut off, not a C3D, without labels, without a
            usable rate or unit, or of a size that no person has.
    """
    data = read_bytes(Path(path), max_bytes)
    name = Path(path).name
    layout = layout_of(data, name)
    unit = unit_of(layout, name)
    points, seen = _points(data, layout)
    labels = point_labels(layout)
    outputs = {label for group in _OUTPUT_GROUPS for label in _strings(layout, group)}
    labelled = [m for m, label in enumerate(labels) if not _UNLABELLED.fullmatch(label) and label not in outputs]
    ghosts = [m for m, label in enumerate(labels) if _UNLABELLED.fullmatch(label)]
    if not labelled:
        raise HighFiveError(f"{name} has {layout.points} points and no labels; label the markers before exporting")
    if not seen[:, labelled].any():
        raise HighFiveError(f"{name} has labels, but not one measured point; check the export")
    recording = Recording(
        rate_hz=layout.rate_hz,
        names=tuple(labels[m] for m in labelled),
        points=points[:, labelled] * UNITS[unit],
        valid=seen[:, labelled],
        unlabelled=points[:, ghosts] * UNITS[unit],
        unlabelled_valid=seen[:, ghosts],
        source=name,
    )
    if trust_unit:
        check_scale(recording, unit)
    return recording


def write_c3d(path: str | Path, recording: Recording) -> None:
    """Writes a recording in millimetres, gaps with residual −1. The file appears whole or not at all.

    Unlabelled points get the names ``*1``, ``*2``, … as Vicon writes them.

    Raises:
        HighFiveError: the file cannot be written (no such folder, no permission, disk full, nothing to write).
    """
    if not recording.rate_hz >= 1.0 or not len(recording) or not recording.names:  # on these ezc3d ends the process
        raise HighFiveError(
            f"cannot write {path} with {len(recording)} frames of {len(recording.names)} markers "
            f"at {recording.rate_hz:g} Hz"
        )
    path = Path(path)
    points = np.concatenate([recording.points, recording.unlabelled], axis=1)
    seen = np.concatenate([recording.valid, recording.unlabelled_valid], axis=1)
    labels = [*recording.names, *(f"*{u + 1}" for u in range(recording.unlabelled.shape[1]))]
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["RATE"]["value"] = [float(recording.rate_hz)]
    file["parameters"]["POINT"]["LABELS"]["value"] = labels
    homogeneous = np.ones((4, points.shape[1], len(points)))
    homogeneous[:3] = np.where(seen[..., None], points * 1e3, np.nan).transpose(2, 1, 0)
    file["data"]["points"] = homogeneous
    if len(points) > 0xFFFF:  # more than the 16 bits of POINT:FRAMES hold
        file.add_parameter("TRIAL", "ACTUAL_START_FIELD", [1, 0])
        file.add_parameter("TRIAL", "ACTUAL_END_FIELD", [len(points) & 0xFFFF, len(points) >> 16])
    file["data"]["meta_points"]["residuals"] = np.where(seen, 0.0, -1.0).T[None]
    try:
        with written_whole(path) as partial:
            file.write(str(partial))
            # ezc3d does not notice a full disk: what was written must be whole before it gets the name.
            layout_of(read_bytes(partial, MAX_BYTES), path.name)
    except (OSError, RuntimeError, HighFiveError) as error:
        raise HighFiveError(f"cannot write {path}: {error}") from None


def unit_of(layout: Layout, name: str) -> str:
    """The unit of the points, one of :data:`UNITS`.

    Raises:
        HighFiveError: the file ``name`` gives another one.
    """
    unit = _text(layout, "UNITS", "mm").strip().lower() or "mm"
    if unit not in UNITS:
        raise HighFiveError(
            f"{name} gives its points in {unit!r}; expected one of {', '.join(UNITS)}; correct POINT:UNITS"
        )
    return unit


def read_bytes(path: Path, max_bytes: int) -> bytes:
    """The bytes of a file that has the size and the first bytes of a C3D file.

    Raises:
        HighFiveError: no such file, no permission, larger than ``max_bytes``, empty, or no C3D file.
    """
    try:
        if not path.is_file():
            raise HighFiveError(f"no file {path}" if not path.exists() else f"{path} is not a file; give a C3D file")
        size = path.stat().st_size
        if size > max_bytes:
            raise HighFiveError(f"{path.name} has {size} bytes, more than the limit of {max_bytes}; cut it into trials")
        data = path.read_bytes()
    except OSError as error:
        raise HighFiveError(f"cannot read {path}: {error.strerror}") from None
    if not data:
        raise HighFiveError(f"{path.name} is empty; expected a C3D file")
    if len(data) < BLOCK or data[1] != 0x50:
        hint = f"; first: highfive import --human {path} --to FOLDER" if path.suffix.lower() in _IMPORTED else ""
        raise HighFiveError(f"{path.name} is not a C3D file (no C3D header in its first {BLOCK} bytes){hint}")
    return data


def layout_of(data: bytes, name: str) -> Layout:
    """Reads header and parameters of the file ``name``.

    Raises:
        HighFiveError: they contradict each other or the size of the file.
    """
    section = (data[0] - 1) * BLOCK
    if section < BLOCK or section + 4 > len(data):
        raise HighFiveError(
            f"{name} is cut off or damaged: its parameters should begin at byte {section} of {len(data)}"
        )
    processor = data[section + 3]
    if processor not in (_INTEL, _DEC, _MIPS):
        raise HighFiveError(f"{name} is damaged: processor type {processor}, expected {_INTEL}, {_DEC} or {_MIPS}")
    end = section + data[section + 2] * BLOCK
    parameters = _parameters(data, section + 4, end if section < end <= len(data) else len(data), processor)
    header = _integers(data[:24], processor).astype(np.uint16)

    def number(parameter: str, otherwise: float) -> float:
        value = parameters.get(("POINT", parameter))
        return float(value.numbers[0]) if value is not None and len(value.numbers) else otherwise

    points = _whole(number("USED", float(header[1])))
    frames = _frame_count(parameters, header)
    start = (_whole(number("DATA_START", float(header[8]))) - 1) * BLOCK
    scale = number("SCALE", -1.0)
    rate = number("RATE", float(_floats(data[20:24], processor)[0]))
    if not (math.isfinite(rate) and 1.0 <= rate <= 10_000.0):
        raise HighFiveError(f"{name} gives a frame rate of {rate:g} Hz; expected 1 to 10000 Hz; correct POINT:RATE")
    if points <= 0 or frames <= 0:
        raise HighFiveError(
            f"{name} holds {max(points, 0)} points in {max(frames, 0)} frames; there is nothing to play"
        )
    if not math.isfinite(scale) or scale == 0.0:
        raise HighFiveError(f"{name} is damaged: POINT:SCALE is {scale:g}")
    words = 4 * points + int(header[2])
    needed = start + frames * words * (4 if scale < 0 else 2)
    if start < BLOCK or needed > len(data):
        raise HighFiveError(
            f"{name} is cut off or damaged: {frames} frames of {points} points need {needed} bytes, it has {len(data)}"
        )
    return Layout(parameters, processor, rate, scale, points, frames, start, words)


def _frame_count(parameters: dict[tuple[str, str], Parameter], header: NDArray[np.uint16]) -> int:
    """Number of frames; a 16-bit count cannot hold more than 65535, so longer files say it elsewhere."""
    first, last = parameters.get(("TRIAL", "ACTUAL_START_FIELD")), parameters.get(("TRIAL", "ACTUAL_END_FIELD"))
    if first is not None and last is not None and len(first.numbers) == 2 and len(last.numbers) == 2:
        fields = [[_whole(number) % 65536 for number in one.numbers] for one in (first, last)]
        low, high = (field[0] + 65536 * field[1] for field in fields)
        return high - low + 1
    stated = parameters.get(("POINT", "FRAMES"))
    count = float(stated.numbers[0]) if stated is not None and len(stated.numbers) else 0.0
    if math.isfinite(count) and count != 0.0:
        return int(count) if count > 0 else int(count) + 65536
    return int(header[4]) - int(header[3]) + 1


def _whole(number: float) -> int:
    """Without its fraction; 0 for one that is none or infinite."""
    return int(number) if math.isfinite(number) else 0


def _parameters(data: bytes, position: int, end: int, processor: int) -> dict[tuple[str, str], Parameter]:
    """All readable parameters by (group, name). Stops at the first record that leads out of the section, or where
    records take more bytes than there are: they lie in each other.
    """
    groups: dict[int, str] = {}
    found: list[tuple[int, str, Parameter]] = []
    view, left = memoryview(data), end - position
    while position + 2 <= end:
        length = abs(int.from_bytes(data[position : position + 1], "big", signed=True))
        group = int.from_bytes(data[position + 1 : position + 2], "big", signed=True)
        body = position + 2 + length
        if length == 0 or body + 2 > end:
            break
        name = data[position + 2 : body].decode("latin-1").strip().upper()
        step = int(_integers(data[body : body + 2], processor)[0])
        if group < 0:
            groups[-group] = name
        else:
            parameter, size = _parameter(view[body + 2 : end], processor)
            found.append((group, name, parameter))
            left -= size
        if step <= 0 or left < 0:
            break
        position = body + step
    return {(groups.get(group, ""), name): parameter for group, name, parameter in found}


def _parameter(record: memoryview, processor: int) -> tuple[Parameter, int]:
    """A parameter, and how many bytes its values take."""
    kind = int.from_bytes(record[:1], "big", signed=True)
    count = record[1] if len(record) > 1 else 0
    shape = tuple(record[2 : 2 + count])
    items = math.prod(shape)
    raw = record[2 + count :][: items * abs(kind)]
    if len(raw) < items * abs(kind):
        return Parameter(np.zeros(0)), 0
    if kind == -1:
        width = shape[0] if shape else 1
        texts = [bytes(raw[i : i + width]) for i in range(0, len(raw), width)] if width else []
        strings = tuple(text.decode("latin-1").strip(" \0") for text in texts)
        return Parameter(np.zeros(0), strings), len(raw)
    if kind == 4:
        return Parameter(_wide(_floats(raw, processor))), len(raw)
    numbers = _integers(raw, processor) if kind == 2 else np.frombuffer(raw, np.uint8)
    return Parameter(numbers.astype(float)), len(raw)


def _integers(raw: bytes | memoryview, processor: int) -> NDArray[np.int16]:
    return np.frombuffer(raw, ">i2" if processor == _MIPS else "<i2").astype(np.int16)


@np.errstate(invalid="ignore")  # bytes can make a number that stands for an error
def _wide(numbers: NDArray[np.float32] | NDArray[np.int16]) -> Array:
    return numbers.astype(float)


def _floats(raw: bytes | memoryview, processor: int) -> NDArray[np.float32]:
    if processor != _DEC:
        return np.frombuffer(raw, ">f4" if processor == _MIPS else "<f4").astype(np.float32)
    # A VAX F float is an IEEE single with its two halves swapped and its exponent two higher.
    swapped = np.frombuffer(raw, "<u2").reshape(-1, 2)[:, ::-1].copy()
    with np.errstate(invalid="ignore", under="ignore"):
        return (swapped.view("<f4")[:, 0] / 4.0).astype(np.float32)


def _strings(layout: Layout, name: str) -> tuple[str, ...]:
    parameter = layout.parameters.get(("POINT", name))
    return parameter.strings if parameter is not None else ()


def _text(layout: Layout, name: str, otherwise: str) -> str:
    strings = _strings(layout, name)
    return strings[0] if strings else otherwise


def point_labels(layout: Layout) -> list[str]:
    """A label for every point; more than 255 of them are spread over LABELS, LABELS2, … . Missing ones are empty."""
    groups = ["LABELS", *(f"LABELS{i}" for i in range(2, 10))]
    labels = [label for group in groups for label in _strings(layout, group)][: layout.points]
    return labels + [""] * (layout.points - len(labels))


def _points(data: bytes, layout: Layout) -> tuple[Array, NDArray[np.bool_]]:
    """Points (T, M, 3) in the file's unit and whether they were seen (T, M)."""
    size = layout.frames * layout.words_a_frame * (4 if layout.scale < 0 else 2)
    raw = data[layout.start : layout.start + size]
    words = _floats(raw, layout.processor) if layout.scale < 0 else _integers(raw, layout.processor)
    words = words.reshape(layout.frames, layout.words_a_frame)[:, : 4 * layout.points]
    words = words.reshape(layout.frames, layout.points, 4)
    with np.errstate(over="ignore", invalid="ignore"):
        points = _wide(words[..., :3]) * (1.0 if layout.scale < 0 else layout.scale)
    seen = (words[..., 3] >= 0) & np.all(np.isfinite(points), axis=-1) & np.any(points != 0.0, axis=-1)
    return np.where(seen[..., None], points, 0.0), seen
