"""What a servo arm was commanded, and did, in a recorded high five, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm
from highfive.hil.recording.session_reader import SessionReader
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class ArmArrays:
    """A servo arm of J joints in a high five.

    Attributes:
        arm: its name, or its folder.
        names: of the joints.
        times: (C,) s of the recording, of the bus's cycles.
        positions: (C, J) rad, as the servos said.
        commanded_times: (S,) s of the recording, of the ticks.
        commanded: (S, J) rad, where the safety envelope let the joints be led, without what goals lead by for load.
    """

    arm: str
    names: tuple[str, ...]
    times: Array
    positions: Array
    commanded_times: Array
    commanded: Array


def arm_arrays(session: SessionReader, place: int) -> ArmArrays | None:
    """Of the high five at a place in the recording; None where no arm took part, or it was not led.

    Raises:
        HighFiveError: the recording is of another version, or of an arm that is not here.
    """
    if not session.settings.get("arm"):
        return None
    high_five = session.read(session.spans[place], ("/arm", "/safety"))
    cycles = [(message.time_ns, message.data) for message in high_five.of("/arm")]
    ticks = [(message.time_ns, message.data) for message in high_five.of("/safety")]
    ticks = [(time, data) for time, data in ticks if isinstance(data, dict) and data.get("reference") is not None]
    if not cycles or not ticks:
        return None
    arm = str(session.settings.get("arm_name") or DEFAULT_ARM)
    try:
        names = find_arm(arm).names
    except HighFiveError as error:
        raise HighFiveError(f"{session.path.name}: {error}") from None
    times, positions = _rows(cycles, "positions", len(names), session.path.name)
    commanded_times, commanded = _rows(ticks, "reference", len(names), session.path.name)
    return ArmArrays(arm, names, times, positions, commanded_times, commanded)


def _rows(messages: Sequence[tuple[int, Any]], field: str, joints: int, name: str) -> tuple[Array, Array]:
    """Times (T,), s, and values (T, J)."""
    try:
        times = 1e-9 * np.array([time for time, _ in messages], dtype=float)
        values = np.array([data[field] for _, data in messages], dtype=float)
    except (KeyError, TypeError, ValueError):
        values, times = np.empty(0), np.empty(0)
    if values.shape != (len(messages), joints) or not np.isfinite(values).all():
        raise HighFiveError(f"{name} is a recording of another version: {field} of its arm is not {joints} numbers")
    return times, values
