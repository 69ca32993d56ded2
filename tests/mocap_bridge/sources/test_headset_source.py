"""A headset as a source: joints become the markers that they are, late by what is known, and lost ones are hidden."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.sim.avatar import avatar_skeleton, right_palm
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.mocap_bridge.sources.address import connector, parse_address
from highfive.mocap_bridge.sources.headset import HAND, NAMES, VIEWER, HeadsetLink, HeadsetSettings, headset_markers
from highfive.mocap_bridge.sources.inferred_arm import FOREARM, UPPER_ARM, elbow_of, shoulder_of
from highfive.mocap_bridge.tracking.filter_settings import HEADSET
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.mocap_bridge.tracking.tracker import Tracker
from highfive.mocap_bridge.wire.errors import LinkError
from highfive.mocap_bridge.wire.headset import JOINTS, LIMBS, HeadsetPose, encode_headset
from highfive.model.geometry import rotations

SET = load_marker_set("headset")
SKELETON = avatar_skeleton()
MIRROR = np.array([1.0, -1.0, 1.0])


def standing(lift: float = 1.0, heading: float = np.pi, size: float = 1.0):
    """Joint centres and orientations of somebody at x = 1 who raises the right hand, the left one by half."""
    body = SKELETON.scaled(dict.fromkeys(SKELETON.names, size))
    angles = np.zeros((1, len(SKELETON), 3))
    angles[0, 0, 0] = heading
    for side, share, sign in (("right", 1.0, 1.0), ("left", 0.5, -1.0)):
        angles[0, SKELETON.index(f"{side}_shoulder"), 0] = -1.2 * lift * share
        angles[0, SKELETON.index(f"{side}_shoulder"), 2] = 0.4 * lift * share * sign
        angles[0, SKELETON.index(f"{side}_elbow"), 0] = -0.2 - 0.9 * lift * share
    root = np.array([[1.0, 0.05, size * SKELETON.offsets[0, 2]]])
    return body, *body.forward_kinematics(root, body.from_hinges(angles))


def worn(lift: float = 1.0, number: int = 0, holds_ms: float = 0.0, **options: float) -> HeadsetPose:
    """What a perfect headset says of that."""
    body, places, turns = standing(lift, **options)
    joints = np.zeros((2, JOINTS, 3))
    for row, side in enumerate(("left", "right")):
        joints[row] = places[0, body.index(f"{side}_wrist")]
        for name, joint in HAND.items():
            joints[row, joint] = places[0, body.index(f"{side}_{name}")]
    head = turns[0, body.index("head")]
    eyes = places[0, body.index("head")] + rotations.rotate(head, [0.09, 0.0, 0.09])
    axes = rotations.to_matrix(head) @ np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    return HeadsetPose(
        number, 0, holds_ms, np.concatenate([eyes, rotations.from_matrix(axes)]), True, joints,
        np.ones((2, JOINTS), dtype=bool), np.zeros((4, 3)), np.zeros(4, dtype=bool),
    )  # fmt: skip


def test_its_marker_set_has_joint_centres_where_the_skeleton_has_them() -> None:
    body, places, turns = standing()
    simulated = SET.simulate(body, places, turns)[0]
    points, seen, _ = headset_markers(worn(), "right", HeadsetSettings())
    assert find_marker_set(NAMES).name == "headset" and set(SET.names) == set(NAMES)
    assert seen.all()
    known = [name for name in NAMES if name not in LIMBS]
    ours = np.array([points[NAMES.index(name)] for name in known])
    np.testing.assert_allclose(ours, simulated[SET.indices(known)], atol=2e-5)


@pytest.mark.parametrize("heading", [np.pi, 0.4])
@pytest.mark.parametrize("size", [0.92, 1.0, 1.08])
def test_inferred_shoulders_and_elbows_are_about_where_they_are_and_say_how_little_that_is(
    heading: float, size: float
) -> None:
    pose, settings = worn(heading=heading, size=size), HeadsetSettings()
    body, places, _ = standing(heading=heading, size=size)
    points, _, covariance = headset_markers(pose, "right", settings)
    for name, most in (("shoulder", 0.06), ("elbow", 0.13)):
        for side in ("left", "right"):
            at = NAMES.index(f"{side}_{name}")
            assert np.linalg.norm(points[at] - places[0, body.index(f"{side}_{name}")]) < most
            assert np.sqrt(covariance[at, 0, 0]) > 5.0 * settings.hand


def test_the_inferred_elbow_keeps_the_bones_lengths_wherever_the_hand_is() -> None:
    rng, forward = np.random.default_rng(3), np.array([-1.0, 0.0, 0.0])
    shoulder = shoulder_of(np.array([1.0, 0.0, 1.67]), forward, np.array([0.0, 0.0, 1.0]), "right", 1.0)
    assert shoulder[1] > 0.1  # facing -x, the right is at +y
    for _ in range(50):
        away = rng.normal(size=3)
        wrist = shoulder + away / np.linalg.norm(away) * rng.uniform(0.1, UPPER_ARM + FOREARM - 0.001)
        elbow = elbow_of(shoulder, wrist, "right", forward, 1.0)
        assert np.linalg.norm(elbow - shoulder) == pytest.approx(UPPER_ARM, abs=1e-6)
        assert np.linalg.norm(wrist - elbow) == pytest.approx(FOREARM, abs=1e-6)


def test_body_tracking_is_taken_instead_where_there_is_some() -> None:
    limbs = np.arange(12.0).reshape(4, 3) / 10.0
    pose = replace(worn(), limbs=limbs, limbs_seen=np.array([False, False, True, True]))
    points, _, covariance = headset_markers(pose, "right", HeadsetSettings())
    for row, name in enumerate(LIMBS[2:], start=2):
        at = NAMES.index(name)
        np.testing.assert_array_equal(points[at], limbs[row])
        assert covariance[at, 0, 0] == pytest.approx(HeadsetSettings().body ** 2)
        assert covariance[NAMES.index(LIMBS[row - 2]), 0, 0] > 4.0 * covariance[at, 0, 0]


def test_who_gives_the_left_hand_is_her_mirror_image() -> None:
    """Mirrored and left-handed twice over: the same markers, hand for hand."""
    pose = worn()
    axes = rotations.to_matrix(pose.viewer[3:])
    # A mirror image turns as the mirror does, with its own left and right changed back.
    behind = np.diag(MIRROR) @ axes @ np.diag([-1.0, 1.0, 1.0])
    other = replace(
        pose, hands=pose.hands[::-1] * MIRROR, hands_seen=pose.hands_seen[::-1],
        viewer=np.concatenate([pose.viewer[:3] * MIRROR, rotations.from_matrix(behind)]),
    )  # fmt: skip
    right, left = headset_markers(pose, "right", HeadsetSettings()), headset_markers(other, "left", HeadsetSettings())
    for ours, theirs in zip(right, left, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


@pytest.mark.parametrize("hand", ["left", "right"])
def test_a_lost_hand_hides_its_own_markers_and_no_other(hand: str) -> None:
    pose = worn()
    lost = replace(pose, hands_seen=pose.hands_seen & (np.array([0, 1]) != ("left", "right").index(hand))[:, None])
    points, seen, _ = headset_markers(lost, "right", HeadsetSettings())
    for name in NAMES:
        hidden = name.startswith(hand) and not name.endswith("shoulder")  # no wrist, no elbow
        assert seen[NAMES.index(name)] != hidden, name
    assert not points[~seen].any()
    nobody = replace(lost, viewer_seen=False, hands_seen=np.zeros((2, JOINTS), dtype=bool))
    assert not headset_markers(nobody, "right", HeadsetSettings())[1].any()


class Wire:
    """The page's messages as a test sends them, and its clock."""

    def __init__(self) -> None:
        self.time_ns, self.sent = 5_000_000_000, list[bytes]()
        self.link = HeadsetLink(self.take, "right", lambda: self.time_ns)

    def take(self, timeout_s: float) -> list[bytes]:
        sent, self.sent = self.sent, []
        return sent

    def frames(self, *poses: HeadsetPose, after_ms: float = 0.0):
        self.time_ns += round(1e6 * after_ms)
        self.sent = [encode_headset(pose) for pose in poses]
        return self.link.receive(0.0)


def test_a_frame_holds_for_when_it_was_predicted_and_a_repeated_hand_is_no_frame() -> None:
    wire, frames = Wire(), []
    for number in range(144):  # 72 pictures a second, a hand 36 times
        pose = worn(0.5 + 0.1 * np.sin(number // 2), number, 5_000.0 + 1e3 * number / 72.0)
        frames += wire.frames(pose, after_ms=1e3 / 72.0)
    assert len(frames) == 72
    first, last = frames[0], frames[-1]
    assert first.own_clock and first.source_time_ns == 5_000_000_000 and first.names == NAMES
    late_ms = HeadsetSettings().late_ms + HeadsetSettings().periods * 1e3 / 36.0
    assert last.latency_ns == pytest.approx(1e6 * late_ms, rel=0.03)
    assert [frame.number for frame in frames] == list(range(1, 73))


def test_a_hand_that_rests_goes_on_being_seen() -> None:
    wire, pose = Wire(), worn()
    frames = [wire.frames(replace(pose, holds_ms=5_000.0 + 10.0 * k), after_ms=10.0) for k in range(100)]
    assert 15 <= sum(map(len, frames)) <= 20  # every 50 ms


def test_what_is_none_and_what_is_for_another_time_is_dropped_and_counted() -> None:
    wire = Wire()
    wire.sent = [b"nonsense", encode_headset(worn(holds_ms=9e9)), encode_headset(worn(holds_ms=5_010.0))]
    assert len(wire.link.receive(0.0)) == 1 and wire.link.dropped == 2


def test_a_headset_that_sleeps_is_said_to_sleep() -> None:
    wire = Wire()
    wire.frames(worn(holds_ms=5_000.0))
    assert wire.frames(after_ms=500.0) == []
    with pytest.raises(LinkError, match="it sleeps, or has left the page"):
        wire.frames(after_ms=500.0)


def test_the_palm_is_where_it_is_and_stays_so_when_the_avatar_is_placed_anew() -> None:
    """Through the tracker: a raised hand, lost for a while, and then another world's origin (re-centring)."""
    tracker, arm, wire, errors, valid = Tracker(SET, settings=HEADSET), HumanArmEstimator(SET), Wire(), [], []
    for k in range(180):
        lift, shift = 0.8 + 0.1 * np.sin(0.05 * k), np.array([0.4, -0.3, 0.0]) * (k >= 120)
        pose = worn(lift, k, 5_000.0 + 1e3 * k / 60.0)
        shown = np.zeros_like(pose.hands_seen) if 60 <= k < 75 else pose.hands_seen
        pose = replace(
            pose, place=int(k >= 120), hands=pose.hands + shift, hands_seen=shown,
            viewer=pose.viewer + np.concatenate([shift, np.zeros(4)]),
        )  # fmt: skip
        (frame,) = wire.frames(pose, after_ms=1e3 / 60.0)
        found = arm(tracker.update(frame))
        body, places, turns = standing(lift)
        errors.append(np.linalg.norm(found.palm.position - right_palm(body, places, turns)[0][0] - shift))
        valid.append(found.valid and found.hand_unseen_ns == 0)
    settled = np.r_[10:60, 80:120, 135:180]
    assert np.max(np.array(errors)[settled]) < 0.01
    assert np.all(np.array(valid)[settled]) and not np.any(valid[60:75])


def test_it_comes_through_the_page_alone() -> None:
    address = parse_address("headset?hand=left")
    assert str(address) == "headset://page?hand=left" and str(parse_address("Headset")) == "headset://page"
    assert VIEWER[0] in NAMES
    with pytest.raises(LinkError, match="simulate --source headset"):
        connector(address)()
