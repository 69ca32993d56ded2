"""The model's answer as a pose of the avatar, with its style's own timing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from highfive.hil.session.open_responder import guarded_rest
from highfive.hil.sim.avatar import Pose, avatar_skeleton, between
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.reaction import Reaction, ReactionModel
from highfive.model.online.style_timing import StyleTiming


class PoseTiming:
    """Poses inside the joint limits, as the model gives them."""

    def __init__(self, rests: Sequence[tuple[Array, Array]]) -> None:
        """Takes the root (3,), m, and joints (D,), rad, in which each of the K styles waits."""
        resting = [_inside_limits(root, joints) for root, joints in rests]
        self._roots = np.array([pose.root_in_world for pose in resting])
        self._hinges = np.array([pose.hinges.ravel() for pose in resting])

    def waiting(self, style: Array) -> Pose:
        """The pose in which an avatar of style weights (K,) waits."""
        return Pose(style @ self._roots, (style @ self._hinges).reshape(-1, 3))

    def answering(self, response: Reaction, style: Array, waiting: Pose) -> Pose:
        """The pose in which it answers in a style (K,), where ``waiting`` is the one in which it waits."""
        return _inside_limits(response.root, response.joints)


class StyledTiming(PoseTiming):
    """Poses inside the joint limits, their reach sharpened as :mod:`highfive.model.online.style_timing` says."""

    def __init__(self, model: HGPDM) -> None:
        """Works out once what does not change from tick to tick."""
        self._timing = StyleTiming(model)
        rests = [self._timing.rest(style) for style in np.eye(len(model.emotions))]
        where = model.channels
        super().__init__([(rest[where.root], rest[: where.joints]) for rest in rests])

    def answering(self, response: Reaction, style: Array, waiting: Pose) -> Pose:
        """The pose in which it answers, between the one it waits in and the one the model gave with ``style`` (K,)."""
        fraction = self._timing.fraction(response.palm, response.contact_point, style)
        return between(waiting, _inside_limits(response.root, response.joints), fraction)


def timing_of(model: HGPDM | ReactionModel) -> PoseTiming:
    """The timing of a model's poses: the hierarchical one keeps its styles apart, another one is played as it is."""
    if isinstance(model, HGPDM):
        return StyledTiming(model)
    return PoseTiming([guarded_rest(model, style) for style in np.eye(len(model.emotions))])


def _inside_limits(root: Array, joints: Array) -> Pose:
    """The pose of a pelvis (3,), m, and rotation vectors (159,), rad, inside the joint limits."""
    return Pose(root, avatar_skeleton().hinges_within(joints))
