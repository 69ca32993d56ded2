"""A hidden arm at the wire: servos that say what its gears let them know, cameras that see its plate's markers.

Driver, bus, servos and body are those of the emulated arm, in virtual time; the markers come as frames of a live
system, with noise, gaps and labels that are swapped now and then.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from highfive.hil.arm.hidden_arm import TEMPLATE, HiddenTruth
from highfive.hil.drivers.bus.rig import Rig
from highfive.hil.drivers.emulator.emulated_bus import EmulatedBus, Plant
from highfive.hil.drivers.emulator.perturbed_servo import PerturbedServo
from highfive.hil.drivers.emulator.servos_of_rig import build_servos
from highfive.hil.runtime.clock import Clock
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.sim.arm_plant import ArmPlant
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.model.geometry.rotations import Array

RATE_HZ = 120.0
LATENCY_NS = 8_000_000


class HiddenServo(PerturbedServo):
    """A servo whose gears give way and whose encoder is not round, neither of which it knows."""

    def __init__(self, *arguments: Any, **more: Any) -> None:
        """As the base class, in order."""
        self.compliance, self.ripple, self._torque = 0.0, np.zeros(2), 0.0
        super().__init__(*arguments, **more)

    def step(self, position: float, velocity: float, now_ns: int, seconds: float) -> float:
        """As the base class, from where its own shaft is: the joint has given way to the torque."""
        shaft = position + self.compliance * self._torque
        shaft -= self.ripple[0] * np.sin(position) + self.ripple[1] * np.cos(position)
        found = super().step(float(shaft), velocity, now_ns, seconds)
        self._torque += 0.05 * (found - self._torque)  # a spring's; the gears' own mass smooths it over 20 ms
        return found


def hidden_bus(
    truth: HiddenTruth, rig: Rig, moves: Callable[[ArmPlant], Plant] = lambda plant: plant
) -> tuple[EmulatedBus, ArmPlant]:
    """The arm where it rests, on a bus that was just switched on, and its body, of which the bus ``moves`` what is made
    there."""
    servos, joints = build_servos(rig, kind=HiddenServo)
    plant = ArmPlant(truth.mount, load_limits().way_points[-1], truth.change)
    bus = EmulatedBus(servos, joints, moves(plant), seed=truth.seed)
    for servo, joint in zip(servos, joints, strict=True):
        servo.astray, servo.play, servo.ripple = float(truth.zero[joint]), float(truth.play[joint]), truth.ripple[joint]
        servo.delay_ns = round(1e9 * truth.lag[joint])
        servo.compliance = float(truth.compliance[joint]) * joints.count(joint)  # each of two carries half
    return bus, plant


AFAR = np.array([[6.0, 5.0, 1.7]])
"""m, where somebody stands who looks on."""


@dataclass
class CameraFaults:
    """What goes wrong with the markers.

    Attributes:
        gaps, swaps: shares of a marker's frames that are lost, and of frames in which two labels are swapped.
        missing: labels that never come.
        swapped: two labels that are always swapped; empty for none.
        loose: label of a marker that moves by 5 mm after ``loose_after_s``; '' for none.
        visitor: (from, to) s, when a hand's marker is beside the plate; empty for never.
        mirrored: the system's axes are left-handed.
        scale: by which it takes lengths for longer.
        up: its axis that points up.
    """

    gaps: float = 0.03
    swaps: float = 0.01
    missing: tuple[str, ...] = ()
    swapped: tuple[str, ...] = ()
    loose: str = ""
    loose_after_s: float = 60.0
    visitor: tuple[float, float] | None = None
    mirrored: bool = False
    scale: float = 1.0
    up: str = "z"


class PlateCamera:
    """Sees a hidden arm's plate; a :class:`highfive.hil.trials.frame_link.Camera`."""

    def __init__(self, clock: Clock, truth: HiddenTruth, plant: ArmPlant, faults: CameraFaults) -> None:
        """From now on."""
        self._clock, self._truth, self._plant, self._faults = clock, truth, plant, faults
        self._rng = np.random.default_rng((truth.seed, 13))
        self._begun, self._number = clock.now(), 0
        self._due = self._begun + LATENCY_NS

    @property
    def next_ns(self) -> int | None:
        """Arrival of the next frame."""
        return self._due

    def arrived(self, now_ns: int) -> Sequence[MarkerFrame]:
        """The newest frame, once it has come; those before it that nobody fetched are lost."""
        if now_ns < self._due:
            return ()
        period = 1e9 / RATE_HZ
        self._number = int((now_ns - LATENCY_NS - self._begun) / period) + 1
        self._due = self._begun + LATENCY_NS + round(self._number * period)
        return (self._frame(now_ns),)

    def _frame(self, now_ns: int) -> MarkerFrame:
        rng, faults, names = self._rng, self._faults, list(TEMPLATE.names)
        seconds = 1e-9 * (now_ns - self._begun)
        places = self._places(seconds) + rng.normal(0.0, 0.0005, (len(names), 3))
        if rng.random() < faults.swaps:
            a, b = rng.choice(len(names), 2, replace=False)
            places[[a, b]] = places[[b, a]]
        if faults.swapped:
            a, b = (names.index(name) for name in faults.swapped)
            places[[a, b]] = places[[b, a]]
        valid = rng.random(len(names)) >= faults.gaps
        kept = [n for n, name in enumerate(names) if name not in faults.missing]
        names, places, valid = [names[n] for n in kept], places[kept], valid[kept]
        if faults.visitor is not None and faults.visitor[0] <= seconds < faults.visitor[1]:
            names, places = [*names, "RFIN"], np.vstack([places, places[:1] + np.array([0.3, 0.0, 0.1])])
            valid = np.append(valid, True)
        # The plate is a subject of its own, and somebody looks on from afar: in a lab it is never alone.
        names, places, valid = [*names, "LFHD"], np.vstack([places, AFAR]), np.append(valid, True)
        places = faults.scale * (places * [1.0, -1.0, 1.0] if faults.mirrored else places)
        places = places[:, [0, 2, 1]] * [1.0, 1.0, -1.0] if faults.up == "y" else places
        return MarkerFrame(
            names=tuple(f"{'plate' if name in TEMPLATE.names else 'human'}:{name}" for name in names),
            positions=np.where(valid[:, None], places, 0.0),
            valid=valid,
            number=self._number,
            source_time_ns=now_ns - LATENCY_NS,
            arrival_time_ns=now_ns,
            unlabelled=np.zeros((0, 3)),
        )

    def _places(self, seconds: float) -> Array:
        pose = self._plant.plate()
        axes = np.stack([pose.normal, np.cross(pose.fingers, pose.normal), pose.fingers], axis=1)
        own = TEMPLATE.places + self._truth.glue
        if self._faults.loose and seconds > self._faults.loose_after_s:
            own = own.copy()
            own[TEMPLATE.names.index(self._faults.loose)] += [0.0, 0.003, 0.004]
        return self._truth.in_mocap(pose.position + own @ axes.T)
