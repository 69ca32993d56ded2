"""``highfive calibrate room``: where the avatar stands and faces, from markers on the floor; no person is watched."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from highfive.calibration.placement_file import save_placement
from highfive.calibration.room_frame import room_from_markers
from highfive.hil.commands.calibration_checks import check_system
from highfive.hil.runtime.folders import check_toml
from highfive.hil.trials.live_partner import live_source
from highfive.hil.trials.live_wiring import MACHINE_WIRING, LiveWiring
from highfive.mocap_bridge.files.recording import EVERYBODY
from highfive.mocap_bridge.sources.address import parse_address
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

FEWEST, SEEN = 60, 0.8
"""Frames that are looked at, and the share of them in which a marker has to be there."""
STILL_M = 0.002
"""m, by which the middle half of a marker's places may lie apart."""
PATIENCE_S = 10.0


@dataclass(frozen=True)
class RoomOptions:
    """What is measured.

    Attributes:
        source: the motion capture's address.
        markers: two or three labels: below the avatar, ahead of it, and to its left.
        height: m, of the markers' middles above the floor.
        out: the placement, for ``--place``.
        overwrite: replace it if it is there.
    """

    source: str
    markers: tuple[str, ...]
    height: float = 0.0
    out: Path = Path("place.toml")
    overwrite: bool = False


def calibrate_room(options: RoomOptions, wiring: LiveWiring = MACHINE_WIRING) -> dict[str, Any]:
    """Looks at the markers for half a second, and writes where the world lies.

    Returns:
        The summary.

    Raises:
        HighFiveError: something cannot be used, a marker is missing or moves, or they are no frame. Nothing is written.
    """
    check_system(options.source)
    names = options.markers
    if len(names) not in (2, 3) or len(set(names)) != len(names) or not all(names):
        raise HighFiveError(f"--markers {','.join(names)}; expected two or three labels, such as origin,ahead,left")
    if not 0.0 <= options.height <= 2.0:
        raise HighFiveError(f"--height {1e3 * options.height:g}; expected 0 to 2000 mm")
    check_toml(options.out, "a placement", options.overwrite)
    with closing(live_source(options.source, EVERYBODY, wiring)) as source:
        source.first()
        frames, frame, end = [], None, wiring.clock.now() + round(1e9 * PATIENCE_S)
        while len(frames) < FEWEST and wiring.clock.now() < end:
            frame = source.wait(frame, 0.5)
            if frame is not None:
                frames.append(frame)
    if len(frames) < FEWEST:
        raise HighFiveError(f"{len(frames)} frames came in {PATIENCE_S:g} s, expected {FEWEST}; is it streaming?")
    places = np.full((len(frames), len(names), 3), np.nan)
    for row, frame in enumerate(frames):
        for marker, name in enumerate(names):
            if name in frame.names and frame.valid[at := frame.names.index(name)]:
                places[row, marker] = frame.positions[at]
    placement = room_from_markers(
        _middles(places, names, sorted({n for f in frames for n in f.names})), names, options.height
    )
    save_placement(
        options.out, placement, parse_address(options.source).scheme, datetime.now(UTC), replace=options.overwrite
    )
    turn = rotations.to_matrix(placement.rotation)
    return {
        "out": str(options.out),
        "markers": list(names),
        "note": placement.notes[0],
        "facing_deg": round(float(np.degrees(np.arctan2(turn[0, 1], turn[0, 0]))), 2),
        "origin_m": (-turn.T @ placement.translation).round(4).tolist(),
    }


def _middles(places: Array, names: tuple[str, ...], sent: list[str]) -> Array:
    """(M, 3) m, medians of what was seen (T, M, 3).

    Raises:
        HighFiveError: a marker is missing, hardly seen, or moves.
    """
    shares = np.isfinite(places).all(axis=2).mean(axis=0)
    if unknown := [name for name, share in zip(names, shares, strict=True) if share == 0.0]:
        raise HighFiveError(f"{', '.join(unknown)} are not seen; the system sends {', '.join(sent) or 'no labels'}")
    for name, share, own in zip(names, shares, places.swapaxes(0, 1), strict=True):
        if share < SEEN:
            raise HighFiveError(
                f"{name} is seen in {share:.0%} of the frames, expected {SEEN:.0%}; clear the view of it"
            )
        low, high = np.nanpercentile(own, [25, 75], axis=0)
        if (moved := float(np.linalg.norm(high - low))) > STILL_M:
            raise HighFiveError(f"{name} moves by {1e3 * moved:.0f} mm; let all lie on the floor, and start again")
    return np.nanmedian(places, axis=0)


def print_room(summary: dict[str, Any]) -> None:
    """The summary for people."""
    x, y, z = (round(value, 3) + 0.0 for value in summary["origin_m"])  # + 0: never -0.000
    print(f"{summary['note']}.")
    print(
        f"Its origin is at {x:.3f}, {y:.3f}, {z:.3f} m of the motion capture's frame, x turned by "
        f"{summary['facing_deg']:.1f}°."
    )
    print(f"Written: {summary['out']}, for simulate --place")
