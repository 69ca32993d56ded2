"""One tick of a session: markers in, corrected pose out."""

from __future__ import annotations

from dataclasses import dataclass, replace

from hil.avatar import Pose, avatar_skeleton
from hil.contact_correction import ContactCorrection
from hil.reach import Phase, Reach, ReachTarget
from hil.sim.scene import Scene
from hil.threads import use_one_blas_thread
from mocap_bridge.frames import HumanArm, MarkerFrame, PalmPose, TrackedMarkers
from mocap_bridge.human_arm import HumanArmEstimator
from mocap_bridge.marker_sets import MarkerSet
from mocap_bridge.palm_filter import PalmFilter
from mocap_bridge.tracker import Tracker
from model.errors import HighFiveError
from model.hgpdm import HGPDM
from model.responder import Responder, Response
from model.rotations import Array

RATE_HZ = 120.0


@dataclass(frozen=True)
class Tick:
    """What one frame led to.

    Attributes:
        markers: every marker of the set, seen or not.
        person: the live person.
        response: what the model answers.
        generated: its pose, inside the joint limits, before correction.
        generated_palm: the palm of ``generated``.
        target: where the palm should be.
        pose: the pose that is played.
        palm: its palm.
        miss: m, distance of ``palm`` from ``target``.
        out_of_reach: the target cannot be reached.
    """

    markers: TrackedMarkers
    person: HumanArm
    response: Response
    generated: Pose
    generated_palm: PalmPose
    target: ReachTarget
    pose: Pose
    palm: PalmPose
    miss: float
    out_of_reach: bool


class Session:
    """The chain from a marker frame to the pose that is played, at 120 Hz."""

    def __init__(
        self, model: HGPDM, style: dict[str, float], marker_set: MarkerSet, scene: Scene, *, correct: bool = True
    ) -> None:
        """Loads nothing and waits for nothing later: what has to be compiled is compiled here.

        Raises:
            HighFiveError: the model was trained for another skeleton, or the style does not fit it.
        """
        expected = avatar_skeleton().hash
        if model.skeleton_hash != expected:
            raise HighFiveError(
                f"the model is for skeleton {model.skeleton_hash or '(none given)'}, the avatar is {expected}; "
                "train a model on this avatar"
            )
        use_one_blas_thread()
        self._tracker = Tracker(marker_set, RATE_HZ)
        self._arm = HumanArmEstimator(marker_set)
        self._palm = PalmFilter()
        self._responder = Responder(model, style, RATE_HZ)
        self._reach = Reach()
        self._correction = ContactCorrection(scene)
        self._correct = correct

    def set_style(self, style: dict[str, float]) -> None:
        """Changes the style weights, at any time."""
        self._responder.set_style(style)

    def reset(self) -> None:
        """A new trial: nobody is there yet."""
        self._tracker.reset()
        self._palm.reset()
        self._responder.reset()
        self._reach.reset()
        self._correction.reset()

    def step(self, frame: MarkerFrame) -> Tick:
        """One tick."""
        markers = self._tracker.update(frame)
        person = self._steady(self._arm(markers))
        response = self._responder.step(person.hand_points if person.valid else None)
        generated = self._pose(response.joints, response.root)
        palm = self._correction.palm_of(generated)
        seen = person.palm if person.valid else None
        clock = response.time_to_contact, response.time_to_contact_std
        target = self._reach.step(palm, seen, *clock, 1.0 / RATE_HZ)
        if not self._correct or target.phase is Phase.IDLE:
            return Tick(markers, person, response, generated, palm, target, generated, palm, 0.0, False)
        corrected = self._correction.solve(generated, target.position, target.normal)
        return Tick(
            markers, person, response, generated, palm, target,
            corrected.pose, corrected.palm, corrected.miss, corrected.out_of_reach,
        )  # fmt: skip

    def _steady(self, person: HumanArm) -> HumanArm:
        """The person with a palm that does not shake."""
        if not person.valid:
            self._palm.reset()
            return person
        return replace(person, palm=self._palm(person.palm, 1.0 / RATE_HZ))

    @staticmethod
    def _pose(joints: Array, root: Array) -> Pose:
        skeleton = avatar_skeleton()
        hinges = skeleton.to_hinges(skeleton.from_rotation_vectors(joints))
        return Pose(root, skeleton.clamp(hinges))
