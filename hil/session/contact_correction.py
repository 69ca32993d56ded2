"""Effector optimisation: the smallest change of trunk and arm that brings the palm where it should be.

A box-constrained Gauss–Newton solve of

    min over q   s² (w_p² |p(q) - p*|² + w_n² |n(q) - n*|²) + (s² + k) c(q)
                 + w_q² (|S (q - q_generated)|² + (1 - s) m |S (q - q_generated - last change)|²)

with q inside the joint limits, where s is the fraction of the correction, 0 while no palm is to be met, c keeps hand
and forearm off the own body (:mod:`highfive.hil.session.own_body`), and the last term keeps the motion smooth. MuJoCo
gives the site's Jacobian and the box QP (Tassa, Mansard & Todorov 2014, "Control-limited differential dynamic
programming", sec. III), damped as by Levenberg and Marquardt where a step makes things worse. Clipping a free step to
the limits instead is no bound: it stalled 30 mm off where the box QP is within 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from highfive.hil.session.own_body import OwnBody
from highfive.hil.sim.avatar import Pose
from highfive.hil.sim.scene import CORRECTED_JOINTS, Scene
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

_JOINT_WEIGHTS = {"thoracic_12": 4.0, "thoracic_8": 4.0, "right_clavicle": 2.5}
"""Of the posture's weight, for joints that move less readily than 1."""


@dataclass(frozen=True)
class CorrectionSettings(Settings):
    """What the correction weighs. Set by hand, unless a field says on what it was chosen."""

    position_weight: float = setting(1.0, "1/m", least=0.0)
    normal_weight: float = setting(0.1, "1/rad", least=0.0)
    posture_weight: float = setting(0.006, "1/rad", above=0.0)
    """Times the joint's own weight."""
    steadiness: float = setting(12.0, least=0.0)
    """Of the posture's weight at weight 0: what the change may not change from tick to tick. Where the palm leaves a
    choice, an arm that the model leads through the own body takes some ticks, not one, from one side to the other.
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
        self._low, self._high = limits[:, 0], limits[:, 1]
        fraction = np.repeat([_JOINT_WEIGHTS.get(name, 1.0) for name in CORRECTED_JOINTS], 3)
        self.posture_cost = (self.settings.posture_weight * fraction) ** 2
        self._pull = self.posture_cost
        count = len(self._dofs)
        self._translation, self._rotation = np.zeros((3, scene.model.nv)), np.zeros((3, scene.model.nv))
        # Views: they show the palm of whatever was computed last.
        self._place = self._data.site_xpos[scene.palm_site]
        self._axes = self._data.site_xmat[scene.palm_site].reshape(3, 3)
        self._work = np.zeros((count, count + 7))
        self._index = np.zeros(count, dtype=np.int32)
        self.reset()

    def reset(self) -> None:
        """Forget the last tick."""
        self._change: Array | None = None

    def palm_of(self, pose: Pose) -> PalmPose:
        """The palm of a pose."""
        self._set(pose)
        mujoco.mj_kinematics(self._model, self._data)
        return self._palm_now()

    @property
    def shoulder(self) -> Array:
        """The right shoulder (3,), m, of the pose that was looked at last."""
        return self._data.xpos[self._shoulder].copy()

    def solve(self, pose: Pose, position: Array, normal: Array, fraction: float = 1.0) -> Correction:
        """The pose next to ``pose``, off the own body, whose palm is at ``position`` (3,) m and faces ``normal`` (3,).

        ``fraction``, 0 to 1, says how much the palm's place counts; at 0 the pose is only kept off the own body.
        """
        generated = self._set(pose)
        before, steady = self._change, (1.0 - fraction) * self.settings.steadiness
        if before is None:
            before, steady = np.zeros_like(generated), 0.0
        # Both terms of the posture are one about a point between what is generated and that with the last change.
        self._pull = self.posture_cost * (1.0 + steady)
        centre = generated + steady / (1.0 + steady) * before
        angles = np.clip(generated + before, self._low, self._high)
        cost, gradient, hessian = self._linearise(angles, centre, position, normal, fraction)
        damping = 1e-7
        for _ in range(self.settings.iterations):
            if cost < self.settings.solved:
                break
            candidate = self._step(angles, gradient, hessian, damping)
            trial = self._linearise(candidate, centre, position, normal, fraction)
            gain = cost - trial[0]
            if gain > 0.0:
                angles, (cost, gradient, hessian) = candidate, trial
                damping = max(0.1 * damping, 1e-7)
            else:
                damping = max(10.0 * damping, 1e-4)
            if abs(gain) < self.settings.converged:
                break
        self._change = angles - generated
        self._data.qpos[self._qpos] = angles
        mujoco.mj_kinematics(self._model, self._data)
        palm = self._palm_now()
        miss = float(np.linalg.norm(palm.position - position))
        return Correction(self._scene.get_pose(self._data), palm, miss, miss > self.settings.out_of_reach)

    def _set(self, pose: Pose) -> Array:
        """Puts a pose into the solver's data; returns the arm's angles (18,)."""
        self._scene.set_pose(self._data, pose)
        return pose.hinges[self._scene.arm_joints].ravel()

    def _palm_now(self) -> PalmPose:
        axes = self._axes
        return PalmPose(self._place.copy(), axes[:, 2].copy(), axes[:, 0].copy(), np.zeros(3))

    def _linearise(
        self, angles: Array, centre: Array, position: Array, normal: Array, fraction: float
    ) -> tuple[float, Array, Array]:
        """Cost, and half its gradient (18,) and its Gauss–Newton second derivatives (18, 18)."""
        self._data.qpos[self._qpos] = angles
        mujoco.mj_kinematics(self._model, self._data)
        moved = angles - centre
        pulled = self._pull * moved
        cost, gradient, hessian = float(pulled @ moved), pulled, np.diag(self._pull)
        if fraction > 0.0:
            residual, jacobian = self._palm_terms(position, normal, fraction)
            cost += float(residual @ residual)
            gradient = gradient + jacobian.T @ residual
            hessian += jacobian.T @ jacobian
        return (
            cost + self._own_body.keep_off(fraction * fraction + self.settings.own_body, gradient, hessian),
            gradient,
            hessian,
        )

    def _palm_terms(self, position: Array, normal: Array, fraction: float) -> tuple[Array, Array]:
        """Residuals (6,) of position and normal, weighted, and their Jacobian (6, 18)."""
        model, data = self._model, self._data
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, self._translation, self._rotation, self._scene.palm_site)
        facing = self._axes[:, 2]
        residual, jacobian = np.empty(6), np.empty((6, len(self._dofs)))
        placed, turned = fraction * self.settings.position_weight, fraction * self.settings.normal_weight
        residual[:3] = placed * (self._place - position)
        residual[3:] = turned * (facing - normal)
        np.multiply(self._translation[:, self._dofs], placed, out=jacobian[:3])
        x, y, z = turned * facing
        turning = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # dn = omega x n
        np.matmul(turning, self._rotation[:, self._dofs], out=jacobian[3:])
        return residual, jacobian

    def _step(self, angles: Array, gradient: Array, hessian: Array, damping: float) -> Array:
        damped = hessian.copy()
        damped.flat[:: len(angles) + 1] += damping
        step = np.zeros_like(angles)
        longest = self.settings.longest_step
        low, high = np.maximum(self._low - angles, -longest), np.minimum(self._high - angles, longest)
        mujoco.mju_boxQP(step, self._work, self._index, damped, gradient, low, high)
        return angles + step
