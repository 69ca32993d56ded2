"""The model's answer as a pose of the avatar, at its style's own tempo."""

from __future__ import annotations

import numpy as np

from highfive.hil.sim.avatar import Pose, avatar_skeleton, between
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.trained import HGPDM
from highfive.model.online.responder import Response
from highfive.model.online.style_timing import Emphasis


class Tempo:
    """Poses inside the joint limits, their reach sharpened as :mod:`highfive.model.online.style_timing` says."""

    def __init__(self, model: HGPDM) -> None:
        """Works out once what does not change from tick to tick."""
        self._emphasis = Emphasis(model)
        rests = [self._emphasis.rest(style) for style in np.eye(len(model.emotions))]
        where = model.channels
        resting = [_inside_limits(rest[where.root], rest[: where.joints]) for rest in rests]
        self._roots = np.array([pose.root_in_world for pose in resting])
        self._hinges = np.array([pose.hinges.ravel() for pose in resting])

    def waiting(self, style: Array) -> Pose:
        """The pose in which an avatar of style weights (K,) waits."""
        return Pose(style @ self._roots, (style @ self._hinges).reshape(-1, 3))

    def answering(self, response: Response, style: Array, waiting: Pose) -> Pose:
        """The pose in which it answers, between the one it waits in and the one the model gave with ``style`` (K,)."""
        share = self._emphasis.share(response.palm, response.contact_point, style)
        return between(waiting, _inside_limits(response.root, response.joints), share)


def _inside_limits(root: Array, joints: Array) -> Pose:
    """The pose of a pelvis (3,), m, and rotation vectors (159,), rad, inside the joint limits."""
    skeleton = avatar_skeleton()
    return Pose(root, skeleton.clamp(skeleton.to_hinges(skeleton.from_rotation_vectors(joints))))
