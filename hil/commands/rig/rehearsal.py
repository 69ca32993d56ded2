"""``highfive rig emulate --plate``: rehearses a calibration: an arm that is not as drawn, and cameras that see it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from highfive.calibration.plate_template import template_text
from highfive.hil.arm.hidden_arm import TEMPLATE, HiddenTruth, drawn_truth
from highfive.hil.arm.hidden_rig import RATE_HZ, CameraFaults, PlateCamera, hidden_bus
from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, ArmFolder, find_arm
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.emulator.bus_faults import parse_faults
from highfive.hil.drivers.emulator.emulated_bus import EmulatedBus
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions
from highfive.hil.runtime.clock import MACHINE
from highfive.hil.runtime.folders import check_toml, write_file
from highfive.hil.sim.arm_plant import ArmPlant
from highfive.mocap_bridge.servers.serving import LOOPBACK
from highfive.mocap_bridge.servers.vicon import ViconServer
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array


@dataclass(frozen=True)
class RehearsalOptions:
    """What is rehearsed.

    Attributes:
        plate: file that the plate's template is written to.
        port: of the motion capture system, on this computer alone; 0 for any that is free.
        overwrite: replace the file if it is there.
    """

    plate: Path
    port: int = 0
    overwrite: bool = False


class SeenArm:
    """A body whose plate is seen as it moves: by the thread that moves it, and no other."""

    def __init__(self, plant: ArmPlant, camera: PlateCamera, server: ViconServer) -> None:
        """From now on."""
        self._plant, self._camera, self._server = plant, camera, server

    def step(self, torques: Array, seconds: float) -> tuple[Array, Array]:
        """As the body's; what is seen meanwhile goes out."""
        answer = self._plant.step(torques, seconds)
        for frame in self._camera.arrived(MACHINE.now()):
            self._server.send(frame)
        return answer


@contextmanager
def rehearsed_arm(
    wanted: RehearsalOptions, options: EmulatorOptions, rig: Rig, folder: ArmFolder
) -> Iterator[tuple[EmulatedBus, str, HiddenTruth]]:
    """The bus of an arm that differs from its drawing as the seed says, the address of the motion capture system that
    sees its plate, and by what it differs.

    Raises:
        HighFiveError: the options do not go together, the template cannot be written, or the port is taken.
    """
    if folder != find_arm() or tuple(joint.name for joint in rig.joints) != folder.names:
        raise HighFiveError(f"--plate: only of {DEFAULT_ARM} is it known how it may differ from its drawing")
    if not (options.configured and options.paced and options.baud_rate is None):
        raise HighFiveError("--plate is for servos that are ready to play: without --factory, --unpaced and --baud")
    check_toml(wanted.plate, "a template", wanted.overwrite, "--plate")
    truth = drawn_truth(options.seed)
    server = ViconServer(port=wanted.port, rate_hz=RATE_HZ)
    try:

        def moves(plant: ArmPlant) -> SeenArm:
            return SeenArm(plant, PlateCamera(MACHINE, truth, plant, CameraFaults()), server)

        bus, _ = hidden_bus(truth, rig, moves)
        bus.set_faults(parse_faults(options.faults, bus.ids))
        write_file(wanted.plate, template_text(TEMPLATE).encode(), replace=wanted.overwrite)
        yield bus, f"vicon://{LOOPBACK}:{server.port}", truth
    finally:
        server.close()


def differences(truth: HiddenTruth) -> dict[str, Any]:
    """By what the arm differs from its drawing, for whoever compares: the calibration never reads it."""
    names = find_arm().names
    return {
        "base_mm": (1e3 * truth.base).round(1).tolist(),
        "base_deg": np.degrees(truth.base_turn).round(2).tolist(),
        "zero_deg": dict(zip(names, np.degrees(truth.zero).round(2).tolist(), strict=True)),
        "plate_mm": (1e3 * truth.plate).round(1).tolist(),
    }


def hidden_lines(hidden: dict[str, Any]) -> list[str]:
    """The same for people."""
    base, turn, plate = (" ".join(f"{x:+g}" for x in hidden[key]) for key in ("base_mm", "base_deg", "plate_mm"))
    return [
        f"what was hidden, beside the drawing: base {base} mm, turned by {turn}°; plate {plate} mm",
        f"  zeros, °: {', '.join(f'{name} {zero:+.2f}' for name, zero in hidden['zero_deg'].items())}",
    ]
