"""All of an actor but the right arm as functions of time."""

from __future__ import annotations

import numpy as np

from highfive.hil.sim.people.role import ARM, TRUNK, Role
from highfive.hil.sim.profiles import minimum_jerk
from highfive.model.geometry.rotations import Array

_FINGER_JOINTS = tuple(f"{f}_{n}" for f in ("index", "middle", "ring", "little") for n in (1, 2, 3))


class BodyMotion:
    """All but the right arm as functions of time: posture, the trunk's part in the reach, gaze, fingers and sway."""

    def __init__(self, role: Role) -> None:
        """Of the actor who plays ``role``."""
        self.role, self.skeleton = role, role.skeleton
        self.arm = [self.skeleton.index(name) for name in ARM]
        self._chain, self._to_clavicle = self.skeleton.chain_to("right_clavicle")
        self._base = self._posture() + role.individual.posture
        self._reach = self._reach_posture()

    def progress(self, times: Array) -> Array:
        """Share of the reach posture (T,), 0 at rest and 1 at contact, minimum jerk both ways."""
        role = self.role
        start, back = role.onset_s - role.individual.trunk_lead, role.contact_s + 0.05
        there = minimum_jerk((times - start) / (role.contact_s - start))
        return there - minimum_jerk((times - back) / (role.end_s - 0.25 - back))

    def without_arm(self, times: Array) -> Array:
        """Hinge angles (T, 53, 3), rad, with legs and right arm at zero."""
        return self._base + self.progress(times)[:, None, None] * self._reach + self._sway(times)

    def root(self, times: Array) -> Array:
        """Pelvis (T, 3) m: shifts forward in the reach, lower for a low cell, and bounces if the emotion does."""
        p, style = self.progress(times), self.role.style
        sway = 0.10 * self._sway(times)[:, 0]
        crouch = 0.012 + 0.06 * np.clip((1.45 - self.role.palm.position[2]) / 0.3, 0.0, 1.0)
        bounce = style.bounce * 4.0 * p * (1.0 - p)
        shift = np.stack(
            [0.02 * p + sway[:, 1], 0.01 * p + sway[:, 0], np.minimum(bounce, 0.4 * bounce) - crouch * p], axis=-1
        )
        return self.skeleton.offsets[0] * [1.0, 1.0, 0.988] + shift

    def _sway(self, times: Array) -> Array:
        """Slow involuntary movement (T, 53, 3), rad: two sinusoids a hinge, about half a degree."""
        who = self.role.individual
        # Counted from contact, so that the posture at contact does not depend on when that is.
        since = (times - self.role.contact_s)[:, None, None, None]
        waves = np.sin(2 * np.pi * who.sway_frequency * since + who.sway_phase)
        return (who.sway_amplitude * waves).sum(axis=1)

    def clavicle(self, time: float) -> tuple[Array, Array]:
        """Position (3,) m and orientation (4,) of the right clavicle joint."""
        times = np.array([time])
        quaternions = self._to_clavicle.from_hinges(self.without_arm(times)[:, self._chain])
        positions, orientations = self._to_clavicle.forward_kinematics(self.root(times), quaternions)
        return positions[0, -1], orientations[0, -1]

    def _posture(self) -> Array:
        style, skeleton = self.role.style, self.skeleton
        degrees = np.zeros((len(skeleton), 3))
        for name in TRUNK:
            degrees[skeleton.index(name), 0] = style.trunk_lean / len(TRUNK)
        degrees[skeleton.index("neck"), 0] = 0.4 * style.head_pitch
        degrees[skeleton.index("head"), 0] = 0.6 * style.head_pitch - 0.5 * style.trunk_lean
        degrees[skeleton.index("right_clavicle")] = (0.0, -style.shoulder_lift, 0.0)
        degrees[skeleton.index("left_clavicle")] = (0.0, style.shoulder_lift, 0.0)
        degrees[skeleton.index("left_shoulder")] = (4.0, style.left_arm_out, 0.0)
        degrees[skeleton.index("left_elbow")] = (-style.rest_elbow, 0.0, -15.0)
        for side, sign in (("right", 1.0), ("left", -1.0)):
            for joint in _FINGER_JOINTS:
                degrees[skeleton.index(f"{side}_{joint}"), 0] = sign * style.finger_curl
            degrees[skeleton.index(f"{side}_thumb_2"), 0] = sign * 0.4 * style.finger_curl
        return np.radians(degrees)

    def _reach_posture(self) -> Array:
        """What is added to the posture at contact: the trunk turns and leans as far as the cell asks for."""
        style, skeleton, palm = self.role.style, self.skeleton, self.role.palm
        degrees = np.zeros((len(skeleton), 3))
        across = np.clip((palm.position[1] + 0.20) / 0.45, 0.0, 1.2)
        height = np.clip((palm.position[2] - 1.1) / 0.6, 0.0, 1.2)
        for name in TRUNK[1:]:
            degrees[skeleton.index(name), 2] = 2.0 + 6.0 * across
        for name in TRUNK:
            lean = style.reach_lean + np.degrees(palm.extra_lean)
            degrees[skeleton.index(name), 0] = lean / len(TRUNK) + 1.5 * across
        degrees[0, 0] = 3.0 + 19.0 * across
        degrees[skeleton.index("right_clavicle")] = (8.0 + 14.0 * across, -6.0 - 14.0 * height, 0.0)
        degrees[skeleton.index("neck"), 2] = -5.0 - 12.0 * across
        degrees[skeleton.index("head"), 2] = -6.0 - 18.0 * across
        degrees[skeleton.index("head"), 0] = -4.0 * height
        degrees[skeleton.index("left_shoulder"), 0] = 8.0
        for joint in _FINGER_JOINTS:  # the hand opens
            degrees[skeleton.index(f"right_{joint}"), 0] = 4.0 - style.finger_curl
        degrees[skeleton.index("right_thumb_2"), 0] = -0.4 * style.finger_curl
        return np.radians(degrees)
