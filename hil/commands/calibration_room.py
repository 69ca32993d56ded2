"""An arm, and who sees its plate: in a room, or, to rehearse, one that is not as drawn, in virtual time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass

from highfive.calibration.plate_template import PlateTemplate
from highfive.hil.arm.arm_files import rig_of
from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.driven_arm import driven_arm, virtual_driven_arm
from highfive.hil.arm.hidden_arm import HiddenTruth, drawn_truth
from highfive.hil.arm.hidden_rig import CameraFaults, PlateCamera, hidden_bus
from highfive.hil.arm.plate_watch import PlateWatch
from highfive.hil.arm.posture_drive import PostureDrive
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import ServoArm
from highfive.hil.drivers.bus.serial_line import MACHINE_WIRING as MACHINE_LINES
from highfive.hil.drivers.bus.serial_line import Wiring
from highfive.hil.drivers.emulator.virtual_rig import PATH, VirtualRig
from highfive.hil.runtime.interrupts import INTERRUPTS
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.trials.live_partner import live_source
from highfive.hil.trials.live_wiring import MACHINE_WIRING
from highfive.hil.trials.plate_wiring import camera_wiring
from highfive.mocap_bridge.files.recording import EVERYBODY

CAMERAS = "vicon://cameras"
"""Of a rehearsal."""


@dataclass(frozen=True)
class CalibrationRoom:
    """Who sees the plate, and the arm, before anything is switched on.

    Attributes:
        watch: sees the plate.
        port, wiring: what its bus is opened by.
        driven: the arm as it is known, ready to be driven.
    """

    watch: PlateWatch
    port: str
    wiring: Wiring
    driven: Callable[[ServoArm], AbstractContextManager[PostureDrive]]


@contextmanager
def calibration_room(
    arm: ArmOptions, source: str | None, template: PlateTemplate, seed: int
) -> Iterator[CalibrationRoom]:
    """Opens the motion capture; without a ``source`` begins the virtual time of an arm that differs from its drawing as
    ``seed`` says.

    Raises:
        HighFiveError: the motion capture cannot be reached.
    """
    if source is not None:
        with closing(live_source(source, EVERYBODY)) as frames:
            frames.first()
            watch = PlateWatch(frames, template, MACHINE_WIRING.clock)
            yield CalibrationRoom(watch, arm.port, MACHINE_LINES, lambda body: driven_arm(arm, body, watch.in_the_way))
        return
    with hidden_room(drawn_truth(seed), arm, template) as room:
        yield room


@contextmanager
def hidden_room(truth: HiddenTruth, arm: ArmOptions, template: PlateTemplate) -> Iterator[CalibrationRoom]:
    """The virtual time of a hidden arm, and cameras with noise, gaps and swapped labels that see its plate."""
    with VirtualClock(truth.seed) as clock, clock.signals_to_first(INTERRUPTS):
        bus, plant = hidden_bus(truth, rig_of(find_arm(arm.arm), arm.rig))
        wiring = camera_wiring(clock, PlateCamera(clock, truth, plant, CameraFaults()))
        with closing(live_source(CAMERAS, EVERYBODY, wiring)) as frames:
            watch, rig = PlateWatch(frames, template, clock), VirtualRig(clock, bus)
            yield CalibrationRoom(
                watch, PATH, rig.wiring, lambda body: virtual_driven_arm(rig, arm, body, watch.in_the_way)
            )
