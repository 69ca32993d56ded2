"""An arm that is not as its files say, in MuJoCo: the truth that calibration is measured against and never reads.

Sizes are assumptions, no real arm was measured: zeros ± 2°, a base by tape measure (20 mm, 2° an axis), lengths 0.7 mm,
axes 0.2°, gears that give 0.5 to 3 mrad/(N·m) at shoulder and elbow, up to 0.3° of play behind the encoder, a ripple of
up to 0.1° once a turn, and a plate mounted 2 mm and 1.5° off with its markers glued to 0.5 mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from highfive.calibration.plate_template import PlateTemplate
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.mount import Mount
from highfive.hil.arm_model.servo_arm import DEFAULT_MOUNT, default_arm
from highfive.hil.sim.arm_body import PREFIX, arm_alone
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

COUNT = 2.0 * np.pi / 4096.0
"""rad of one count of a servo."""
ZERO, RIPPLE, REPEAT = np.radians(2.0), np.radians(0.1), np.radians(0.06)
"""rad: zeros and ripple at most, and the standard deviation of what a joint does not repeat."""
TAPE_M, TAPE_RAD = 0.02, np.radians(2.0)
LENGTH_M, TILT_RAD = 0.0007, np.radians(0.2)
PLATE_M, PLATE_RAD, GLUE_M = 0.002, np.radians(1.5), 0.0005
PLAY_RAD, LAG_S = np.radians(0.3), 0.006

TEMPLATE = PlateTemplate(
    names=("plate1", "plate2", "plate3", "plate4", "stalk"),
    places=np.array(
        [
            [-0.006, 0.0, 0.062],
            [-0.006, 0.058, -0.022],
            [-0.006, -0.050, -0.037],
            [-0.006, -0.033, 0.053],
            [-0.056, 0.020, 0.040],
        ]
    ),
    centre=default_arm().packed.plate,
    normal=np.array([1.0, 0.0, 0.0]),
)
"""Of the plate that the hidden arms carry: four markers on its rim and one on a stalk behind it."""


@dataclass(frozen=True)
class HiddenTruth:
    """In what an arm differs from its files.

    Attributes:
        seed: it was drawn from.
        base, base_turn: (3,) m and (3,) rad, of the base beside its mount, in the world.
        zero, compliance, play: (J,) rad, rad/(N·m), rad.
        ripple: (J, 2) rad, of sine and cosine.
        length, tilt: (J, 3) m and rad, in the frame before the joint.
        plate, plate_turn: (3,) m and rad, of the plate beside its drawing, in the last joint's frame.
        glue: (M, 3) m, of the markers beside the template.
        lag: (J,) s, by which servos act on their goals later than the model's.
        mocap, mocap_place: (4,) quaternion and (3,) m, from the world to the motion capture's frame; z is up in both.
    """

    seed: int
    base: Array
    base_turn: Array
    zero: Array
    compliance: Array
    play: Array
    ripple: Array
    length: Array
    tilt: Array
    plate: Array
    plate_turn: Array
    glue: Array
    lag: Array
    mocap: Array
    mocap_place: Array

    @property
    def mount(self) -> Mount:
        """As the arm's file has it; what differs is in the body: :meth:`change`."""
        return DEFAULT_MOUNT

    def change(self, model: Any) -> None:  # MuJoCo's stubs lack what it changes
        """Makes a compiled model with the arm in it the true one."""
        base = model.body(PREFIX + "base").id
        model.body_pos[base] += self.base
        turn = rotations.from_rotation_vector(self.base_turn)
        model.body_quat[base] = rotations.multiply(turn, model.body_quat[base])
        for name, length, tilt in zip(find_arm().names, self.length, self.tilt, strict=True):
            body = int(model.joint(PREFIX + name).bodyid[0])
            model.body_pos[body] += length
            model.body_quat[body] = rotations.multiply(model.body_quat[body], rotations.from_rotation_vector(tilt))
        plate = model.body(PREFIX + "plate").id
        model.body_pos[plate] += self.plate
        model.body_quat[plate] = rotations.multiply(
            rotations.from_rotation_vector(self.plate_turn), model.body_quat[plate]
        )

    def in_mocap(self, points: Array) -> Array:
        """Points (..., 3), m, of the world where the motion capture has them."""
        return rotations.rotate(self.mocap, points) + self.mocap_place


def drawn_truth(seed: int, play: float = 0.0) -> HiddenTruth:
    """A truth of a seed; ``play`` rad at most in each joint."""
    rng, joints = np.random.default_rng((seed, 7)), len(find_arm().names)
    compliance = np.zeros(joints)
    compliance[1:3] = rng.uniform(0.0005, 0.003, 2)
    wave, phase = rng.uniform(0.0, RIPPLE, joints), rng.uniform(0.0, 2.0 * np.pi, joints)
    return HiddenTruth(
        seed=seed,
        base=rng.normal(0.0, TAPE_M, 3),
        base_turn=rng.normal(0.0, TAPE_RAD, 3),
        zero=rng.uniform(-ZERO, ZERO, joints),
        compliance=compliance,
        play=rng.uniform(0.0, play, joints) if play else np.zeros(joints),
        ripple=wave[:, None] * np.stack([np.cos(phase), np.sin(phase)], axis=1),
        length=rng.normal(0.0, LENGTH_M, (joints, 3)),
        tilt=rng.normal(0.0, TILT_RAD, (joints, 3)),
        plate=rng.normal(0.0, PLATE_M, 3) / np.sqrt(3.0),
        plate_turn=rng.normal(0.0, PLATE_RAD, 3) / np.sqrt(3.0),
        glue=rng.normal(0.0, GLUE_M, TEMPLATE.places.shape) / np.sqrt(3.0),
        lag=np.random.default_rng((seed, 19)).uniform(0.0, LAG_S, joints),
        mocap=rotations.from_axis_angle("z", rng.uniform(-np.pi, np.pi)),
        mocap_place=np.array([*rng.uniform(-3.0, 3.0, 2), rng.uniform(-0.1, 0.1)]),
    )


class HiddenArm:
    """A true arm that stands still where it is put."""

    def __init__(self, truth: HiddenTruth, seed: int = 0) -> None:
        """``seed`` of what does not repeat."""
        self.truth = truth
        self._rng = np.random.default_rng((truth.seed, seed, 11))
        self._twin = arm_alone(truth.mount)
        truth.change(self._twin.model)
        self._data: Any = mujoco.MjData(self._twin.model)  # MuJoCo's stubs lack what it has
        self._plate = self._twin.model.body(PREFIX + "plate").id

    def stand(self, encoders: Array, sides: Array, *, repeat: bool = True) -> None:
        """Stands where the encoders say (J,), rad, having come from the sides (J,)."""
        it, torques = self.truth, np.zeros(len(encoders))
        noise = self._rng.normal(0.0, REPEAT, len(encoders)) if repeat else 0.0
        ripple = it.ripple[:, 0] * np.sin(encoders) + it.ripple[:, 1] * np.cos(encoders)
        still = encoders + it.zero + 0.5 * it.play * sides + ripple + noise
        for _ in range(4):
            self._data.qpos[self._twin.qpos] = still - it.compliance * torques
            mujoco.mj_forward(self._twin.model, self._data)
            torques = self._data.qfrc_bias[self._twin.dofs].copy()

    def plate(self) -> tuple[Array, Array]:
        """Middle (3,), m, and normal (3,) of its surface in the motion capture's frame."""
        axes = self._data.xmat[self._plate].reshape(3, 3)
        normal = rotations.rotate(self.truth.mocap, axes[:, 0])
        return self.truth.in_mocap(self._data.xpos[self._plate]), normal

    def markers(self) -> Array:
        """(M, 3) m, in the motion capture's frame."""
        axes = self._data.xmat[self._plate].reshape(3, 3)
        return self.truth.in_mocap(self._data.xpos[self._plate] + (TEMPLATE.places + self.truth.glue) @ axes.T)
