"""A headset's registration beside a motion capture system kept in a file, until the headset's space is set anew."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from highfive.calibration.headset_fit import HeadsetRegistration
from highfive.calibration.placement_file import check_frame, vector
from highfive.model.errors import HighFiveError
from highfive.model.files import write_whole
from highfive.model.geometry.rotations import Array
from highfive.model.toml_file import number, read_toml, table, typed

FORMAT = 1
"""Version of the file's format."""
_NUMBERS = {"delay_s": (-1.0, 1.0), "residual_m": (0.0, 1.0), "residual_rad": (0.0, 4.0), "hand_sigma_m": (0.0, 1.0)}
"""What they may be: further off, the unit is wrong."""


@dataclass(frozen=True)
class KeptRegistration:
    """A registration, and what it belongs to.

    Attributes:
        registration: from the headset's space to the motion capture's frame.
        system: the motion capture, as in its address: ``vicon``.
        marker_set: whose markers of the head make the body.
        measured: when, UTC.
    """

    registration: HeadsetRegistration
    system: str
    marker_set: str
    measured: datetime


def save_headset(path: Path, kept: KeptRegistration, *, replace: bool = False) -> None:
    """Writes a registration in one piece.

    Raises:
        HighFiveError: it cannot be written, or there is such a file and it is not to be replaced.
    """
    found = kept.registration
    content = (
        "# Where a headset's space lies in the motion capture's frame. It holds until the headset's space is set anew\n"
        "# (recentred, another room): then run `highfive calibrate headset` again.\n"
        f"[meta]\nformat = {FORMAT}\ndate = {kept.measured:%Y-%m-%dT%H:%M:%SZ}\n\n"
        f'[headset]\nsystem = "{kept.system}"\nmarker_set = "{kept.marker_set}"\n'
        f"rotation = {_list(found.rotation)}  # w, x, y, z: from the headset's space (z up) to the system's frame\n"
        f"translation_m = {_list(found.translation)}  # added after the rotation\n"
        f"eyes_rotation = {_list(found.eyes_rotation)}  # of the eyes, in the body of the head's markers\n"
        f"eyes_translation_m = {_list(found.eyes_translation)}\n"
        f"delay_s = {found.delay_s:.6f}  # the headset's poses hold for a time so much later\n"
        f"residual_m = {found.residual_m:.6f}\nresidual_rad = {found.residual_rad:.6f}\n"
        f"hand_sigma_m = {found.hand_sigma_m:.6f}  # how sure a hand before the eyes is\n"
    )
    try:
        write_whole(path, content.encode(), replace=replace)
    except OSError as error:
        raise HighFiveError(f"cannot write the registration {path}: {error.strerror or error}") from None


def load_headset(path: Path, system: str, marker_set: str | None = None) -> KeptRegistration:
    """Reads a registration of this system, and of this marker set if one is given.

    Raises:
        HighFiveError: it cannot be read, is none, or is of another system or set; one line says what.
    """
    data = read_toml(path, "the headset's registration")
    try:
        meta, entry = table(data, "meta"), table(data, "headset")
        if (version := typed(meta, "meta.", "format", int)) != FORMAT:
            raise HighFiveError(f"meta.format is {version}, this program reads {FORMAT}")
        measured = typed(meta, "meta.", "date", datetime).astimezone(UTC)
        turns = [vector(entry, "headset.", name, 4) for name in ("rotation", "eyes_rotation")]
        places = [vector(entry, "headset.", name, 3) for name in ("translation_m", "eyes_translation_m")]
        for turn, place in zip(turns, places, strict=True):
            check_frame(turn, place, "headset.")
        numbers = [float(number(entry, "headset.", name, float, *bounds)) for name, bounds in _NUMBERS.items()]
        found = HeadsetRegistration(turns[0], places[0], turns[1], places[1], *numbers)
        kept = KeptRegistration(
            found, typed(entry, "headset.", "system", str), typed(entry, "headset.", "marker_set", str), measured
        )
    except HighFiveError as error:
        raise HighFiveError(
            f"{path} is no registration of a headset: {error}; run highfive calibrate headset"
        ) from None
    if kept.system.lower() != system.lower():
        raise HighFiveError(
            f"{path} is of a headset beside a {kept.system} system, the person comes from {system}; run highfive "
            "calibrate headset with this one"
        )
    if marker_set is not None and kept.marker_set != marker_set:
        raise HighFiveError(
            f"{path} is of marker set {kept.marker_set}, the person wears {marker_set}; run highfive calibrate headset"
        )
    return kept


def _list(values: Array) -> str:
    return "[" + ", ".join(f"{value:.12f}" for value in values) + "]"
