"""Effector optimisation: the smallest change of trunk and arm that brings the palm where it should be.

A box-constrained Gauss–Newton solve of

    min over q   s² (w_p² |p(q) - p*|² + w_n² |n(q) - n*|²) + (s² + k) c(q)
                 + w_q² (|S (q - q_generated)|² + (1 - s) m |S (q - q_generated - last change)|²)

with q inside the joint limits, where s is the fraction of the correction, 0 while no palm is to be met, c keeps hand
and forearm off the own body (:mod:`highfive.hil.session.own_body`), and the last term keeps the motion smooth: m is a
time over that since the last tick, so that the change fades as quickly whatever the rate. MuJoCo
gives the kinematics and the box QP (Tassa, Mansard & Todorov 2014, "Control-limited differential dynamic
programming", sec. III), damped as by Levenberg and Marquardt where a step makes things worse. Clipping a free step to
the limits instead is no bound: it stalled 30 mm off where the box QP is within 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from highfive.hil.session.correction_cost import bounded, palm_and_posture
from highfive.hil.session.own_body import OwnBody
from highfive.hil.sim.avatar import Pose
from highfive.hil.sim.scene import CORRECTED_JOINTS, Scene, rest_pose
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

_JOINT_WEIGHTS = {"thoracic_12": 4.0, "thoracic_8": 4.0, "right_clavicle": 2.5}
"""Of the posture's weight, for joints that move less readily than 1."""

_TICK_S = 1.0 / 120.0  # of the usual rate


@dataclass(frozen=True)
class CorrectionSettings(Settings):
    """What the correction weighs. Set by hand, unless a field says on what it was chosen."""

    position_weight: float = setting(1.0, "1/m", least=0.0)
    normal_weight: float = setting(0.1, "1/rad", least=0.0)
    posture_weight: float = setting(0.006, "1/rad", above=0.0)
    """Times the joint's own weight."""
    steadiness: float = setting(0.1, "s", least=0.0)
    """Over a tick's time, of the posture's weight at weight 0: what the change may not change from tick to tick. Where
    the palm leaves a choice, an arm that the model leads through the own body takes so long from one side to the other,
    not one tick.
    Chosen, as ``own_body``, on simulated high fives of seeds 0, 7, 101 and 202."""
    own_body: float = setting(0.004, above=0.0)
    """How strongly hand and forearm are kept off the own body while no palm is to be met."""
    iterations: int = setting(6, least=1)
    """At most, to bound the cost of a tick."""
    converged: float = setting(1e-9, "m²", above=0.0)
    """An iteration that gains less is the last: 0.03 mm."""
    solved: float = setting(1e-16, "m²", above=0.0)
    """A cost below it leaves nothing to correct."""
    longest_step: float = setting(0.5, "rad", above=0.0)
    """Of an iteration: the model is linear for some 30° at the most."""
    out_of_reach: float = setting(0.004, "m", above=0.0)
    """A palm that stays further than this from its target is out of reach."""


@dataclass(frozen=True)
class Correction:
    """A corrected pose.

    Attributes:
        pose: inside the joint limits.
        palm: the palm of ``pose`` (its velocity is not filled in).
        miss: m, distance of the palm from its target.
        out_of_reach: the target lies beyond what trunk and arm can do off the own body; ``pose`` is the nearest.
    """

    pose: Pose
    palm: PalmPose
    miss: float
    out_of_reach: bool


class ContactCorrection:
    """The solver; it starts each tick from the last tick's change."""

    def __init__(self, scene: Scene, settings: CorrectionSettings | None = None) -> None:
        """Makes a state of its own in ``scene``."""
        self.settings = settings or CorrectionSettings()
        self._scene, self._model = scene, scene.model
        self._data = mujoco.MjData(scene.model)
        self._own_body = OwnBody(scene, self._data)
        self._dofs = scene.arm_dofs
        self._shoulder = scene.model.body("right_shoulder").id
        self._qpos = scene.hinge_qpos[scene.arm_joints].ravel()
        limits = scene.skeleton.hinge_limits[scene.arm_joints].reshape(-1, 2)
        self._limits = limits[:, 0].copy(), limits[:, 1].copy()
        fraction = np.repeat([_JOINT_WEIGHTS.get(name, 1.0) for name in CORRECTED_JOINTS], 3)
        self.posture_cost = (self.settings.posture_weight * fraction) ** 2
        self._pull = self.posture_cost
        count = len(self._dofs)
        # Views: they show the palm and the hinges of whatever was computed last.
        self._place = self._data.site_xpos[scene.palm_site]
        self._axes = self._data.site_xmat[scene.palm_site].reshape(3, 3)
        self._palm = self._place, self._data.site_xmat[scene.palm_site]
        turning = scene.model.dof_jntid[self._dofs].astype(np.int64)
        self._hinges = self._data.xanchor, self._data.xaxis, turning
        self._work = np.zeros((count, count + 7))
        self._index = np.zeros(count, dtype=np.int32)
        self._box = np.zeros(count), np.zeros(count)
        self.reset()
        rest = rest_pose(scene.skeleton)
        self.solve(rest, self.palm_of(rest).position + 0.01, np.array([0.0, 0.0, 1.0]))  # nothing is left to compile
        self.reset()

    def reset(self) -> None:
        """Forget the last tick."""
        self._change: Array | None = None
        self._posed: Pose | None = None  # whose joints are in the solver's data, but for the arm's

    def palm_of(self, pose: Pose) -> PalmPose:
        """The palm of a pose."""
        self._set(pose)
        mujoco.mj_kinematics(self._model, self._data)
        return self._palm_now()

    @property
    def shoulder(self) -> Array:
        """The right shoulder (3,), m, of the pose that was looked at last."""
        return self._data.xpos[self._shoulder].copy()

    def solve(
        self, pose: Pose, position: Array, normal: Array, fraction: float = 1.0, seconds: float = _TICK_S
    ) -> Correction:
        """The pose next to ``pose``, off the own body, whose palm is at ``position`` (3,) m and faces ``normal`` (3,).

        Args:
            pose: as it was generated.
            position, normal: of the palm, in the world.
            fraction: 0 to 1, how much the palm's place counts; at 0 the pose is only kept off the own body.
            seconds: since the tick before.
        """
        if self._posed is not pose:
            self._set(pose)
        generated = pose.hinges[self._scene.arm_joints].ravel()
        before, steady = self._change, (1.0 - fraction) * self.settings.steadiness / seconds
        if before is None:
            before, steady = np.zeros_like(generated), 0.0
        # Both terms of the posture are one about a point between what is generated and that with the last change.
        self._pull = self.posture_cost * (1.0 + steady)
        centre = generated + steady / (1.0 + steady) * before
        angles = np.clip(generated + before, *self._limits)
        cost, gradient, hessian = self._linearise(angles, centre, position, normal, fraction)
        damping, shown = 1e-7, True
        for _ in range(self.settings.iterations):
            if cost < self.settings.solved:
                break
            candidate = self._step(angles, gradient, hessian, damping)
            trial = self._linearise(candidate, centre, position, normal, fraction)
            gain = cost - trial[0]
            shown = gain > 0.0
            if shown:
                angles, (cost, gradient, hessian) = candidate, trial
                damping = max(0.1 * damping, 1e-7)
            else:
                damping = max(10.0 * damping, 1e-4)
            if abs(gain) < self.settings.converged:
                break
        self._change = angles - generated
        if not shown:
            self._show(angles)
        palm = self._palm_now()
        miss = float(np.linalg.norm(palm.position - position))
        hinges = pose.hinges.copy()
        hinges[self._scene.arm_joints] = angles.reshape(-1, 3)
        return Correction(Pose(pose.root_in_world, hinges), palm, miss, miss > self.settings.out_of_reach)

    def _set(self, pose: Pose) -> None:
        """Puts a pose into the solver's data."""
        self._scene.set_pose(self._data, pose)
        self._posed = pose

    def _show(self, angles: Array) -> None:
        """Puts the arm (18,), rad, into the solver's data."""
        self._data.qpos[self._qpos] = angles
        mujoco.mj_kinematics(self._model, self._data)

    def _palm_now(self) -> PalmPose:
        axes = self._axes
        return PalmPose(self._place.copy(), axes[:, 2].copy(), axes[:, 0].copy(), np.zeros(3))

    def _linearise(
        self, angles: Array, centre: Array, position: Array, normal: Array, fraction: float
    ) -> tuple[float, Array, Array]:
        """Cost, and half its gradient (18,) and its Gauss–Newton second derivatives (18, 18)."""
        self._show(angles)
        gradient, hessian = np.empty_like(angles), np.empty((len(angles), len(angles)))
        target = position, normal, fraction * self.settings.position_weight, fraction * self.settings.normal_weight
        posture = angles - centre, self._pull
        cost = palm_and_posture(self._palm, self._hinges, target, posture, gradient, hessian)
        cost += self._own_body.keep_off(fraction * fraction + self.settings.own_body, gradient, hessian)
        return cost, gradient, hessian

    def _step(self, angles: Array, gradient: Array, hessian: Array, damping: float) -> Array:
        damped, step = hessian.copy(), np.zeros_like(angles)
        bounded(angles, self._limits, self.settings.longest_step, damping, damped, self._box)
        mujoco.mju_boxQP(step, self._work, self._index, damped, gradient, *self._box)
        return angles + step
