"""Which arm takes part in a session, and what was said about who is near it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from highfive.hil.arm_model.arm_folder import DEFAULT_ARM

EMULATED = "emulated"
"""In place of a port: an emulated arm, started for the session."""

VIRTUAL = "virtual"
"""In place of a port: an emulated arm in virtual time: the same bits each time, however long computing takes."""


@dataclass(frozen=True)
class ArmOptions:
    """Which arm.

    Attributes:
        port: path of a serial port, :data:`EMULATED` or :data:`VIRTUAL`.
        rig: file of the rig; None for the arm's own.
        limits: file of limits, none of them less safe than the arm's own; None for these.
        lower: limits that are made safer, such as ``contact.speed=0.5``.
        armed: a person said that a real arm may move.
        estop: path of a named pipe that pulls the emergency stop, besides key and signals.
        faults: what goes wrong on an emulated bus.
        person: address of the live person whom the arm meets; '' where nobody is tracked.
        calibration: file that says where the arm stands in that person's room, and by what it differs from its drawing;
            None for what the rig's file names.
        nobody_near: the operator answers for it that the arm can reach nobody.
        slow: every known point of the arm is as slow as near a face.
        arm: name of the arm, or its folder.
        as_drawn: its calibration is being measured: none is taken.
    """

    port: str = EMULATED
    rig: Path | None = None
    limits: Path | None = None
    lower: tuple[str, ...] = ()
    armed: bool = False
    estop: Path | None = None
    faults: tuple[str, ...] = ()
    person: str = ""
    calibration: Path | None = None
    nobody_near: bool = False
    slow: bool = False
    arm: str = DEFAULT_ARM
    as_drawn: bool = False

    @property
    def emulated(self) -> bool:
        """No real arm moves."""
        return self.port in (EMULATED, VIRTUAL)

    @property
    def never_silent(self) -> bool:
        """Its servos answer whenever they get the processor: they are emulated, and nothing is to go wrong."""
        return self.emulated and not self.faults
