"""The filter of a webcam's landmarks: laws, and how far off it is on what the nets saw of a person of known truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from highfive.hil.bench.webcam_recorded import CHOICE, TILTED, RecordedClip, load_clips
from highfive.mocap_bridge.sources.camera_filter import CameraState, _measured, corrected, first_camera_state, predicted
from highfive.mocap_bridge.sources.camera_look import _MIRROR, Look, look
from highfive.mocap_bridge.sources.camera_person import TO_ROOM, CameraPerson
from highfive.mocap_bridge.sources.camera_settings import (
    BONES,
    ELBOW,
    JOINTS,
    KNUCKLES,
    MARKERS,
    SHOULDER,
    WRIST,
    Camera,
    CameraSettings,
)
from highfive.mocap_bridge.wire.landmarks import Landmarks

SETTINGS = CameraSettings()
CAMERA = Camera.of((1280, 720), SETTINGS.field_of_view)


@pytest.fixture(scope="module")
def clips() -> list[RecordedClip]:
    return load_clips()


def clip(clips: list[RecordedClip], emotion: str, cell: str) -> RecordedClip:
    return next(one for one in clips if (one.emotion, one.cell) == (emotion, cell))


def standing(depth: float = 2.0) -> np.ndarray:
    """Joints (6, 3), m, of a person 1.75 m tall who raises her right hand before the camera; her bones are right."""
    height = SETTINGS.height
    points = np.zeros((6, 3))
    points[SHOULDER], points[4], points[5] = (-0.187, -0.2, depth), (0.187, -0.2, depth), (0.0, -0.42, depth)
    ways = ((0.0, 0.8, -0.6), (0.1, -0.7, -0.7), (0.0, -1.0, 0.0))
    for (one, other, share), way in zip(BONES, ways, strict=True):
        points[other] = points[one] + share * height * np.array(way) / np.linalg.norm(way)
    return points


def seen(points: np.ndarray) -> Look:
    """What a net without an error says of them."""
    middle = 0.5 * (points[SHOULDER, 2] + points[4, 2])
    everything = np.ones(6, dtype=bool)
    return Look(
        CAMERA.pixels(points), np.array(SETTINGS.across), everything, points[:, 2] - middle, middle, points[KNUCKLES, 2]
    )


def settled(looked: Look, settings: CameraSettings = SETTINGS, pictures: int = 60) -> CameraState:
    state = first_camera_state(looked, CAMERA, settings)
    assert state is not None
    for _ in range(pictures):
        state = corrected(predicted(state, 1 / 30, settings), looked, 1 / 30, CAMERA, settings)
    return state


def test_pixels_and_points_are_inverse() -> None:
    points = np.random.default_rng(0).uniform([-1, -1, 0.5], [1, 1, 4], (20, 3))
    np.testing.assert_allclose(CAMERA.points(CAMERA.pixels(points), points[:, 2]), points, atol=1e-12)
    edge = CAMERA.points(np.array([1280.0, 360.0]), 1.0)
    assert 2 * np.degrees(np.arctan2(edge[0], edge[2])) == pytest.approx(SETTINGS.field_of_view)


def test_derivatives_are_those_of_what_is_measured() -> None:
    points = standing()
    points[ELBOW, 2] += 0.5  # so far behind that the front rule speaks, too
    looked = replace(seen(standing()), depths=np.linspace(-0.2, 0.1, 6))
    _, jacobian, variance = _measured(points, looked, 1 / 30, CAMERA, SETTINGS)
    assert (variance > 0.0).all()
    for i in range(18):
        step = np.zeros(18)
        step[i] = 1e-6
        ahead, _, _ = _measured(points + step.reshape(6, 3), looked, 1 / 30, CAMERA, SETTINGS)
        back, _, _ = _measured(points - step.reshape(6, 3), looked, 1 / 30, CAMERA, SETTINGS)
        np.testing.assert_allclose((back - ahead) / 2e-6, jacobian[:, i], atol=2e-4, rtol=1e-5)


def test_what_is_seen_without_an_error_is_found() -> None:
    points = standing()
    np.testing.assert_allclose(settled(seen(points)).points, points, atol=0.004)


def test_lengths_of_bones_find_a_depth_that_the_nets_say_wrong() -> None:
    points = standing()
    looked = seen(points)
    # The nets make people flat, and how far away the person is is known here.
    flat = replace(looked, depths=0.4 * looked.depths, hand_distance=np.nan)
    sure = replace(SETTINGS, size_depth=0.002, girdle=0.002)
    believed = settled(flat, replace(sure, bone=10.0)).points
    known = settled(flat, replace(sure, bone=0.003)).points
    gaps = [np.abs(found - points)[[ELBOW, WRIST], 2].max() for found in (believed, known)]
    assert gaps[0] > 0.15 and gaps[1] < 0.4 * gaps[0]


def test_the_mirrored_arm_behind_the_shoulder_is_left() -> None:
    points = standing()
    looked = replace(seen(points), depths=np.zeros(6), hand_distance=np.nan)
    state = settled(looked, pictures=5)
    mean = state.mean.copy()
    for joint in (ELBOW, WRIST, KNUCKLES):  # as far behind the shoulders as it is before them, on the same rays
        depth = 2.0 * points[SHOULDER, 2] - points[joint, 2]
        mean[3 * joint : 3 * joint + 3] = points[joint] * depth / points[joint, 2]
    state = CameraState(mean, state.covariance)
    for _ in range(90):
        state = corrected(predicted(state, 1 / 30, SETTINGS), looked, 1 / 30, CAMERA, SETTINGS)
    assert (state.points[[ELBOW, WRIST], 2] < state.points[SHOULDER, 2] + SETTINGS.front).all()


def test_who_is_taller_and_further_away_looks_the_same() -> None:
    points = standing()
    taller = settled(seen(points), replace(SETTINGS, height=1.1 * SETTINGS.height)).points
    assert np.median(taller[:, 2] / points[:, 2]) > 1.0
    rays = taller[:, :2] / taller[:, 2:] - points[:, :2] / points[:, 2:]
    assert np.abs(rays).max() < 0.02


def test_covariances_are_such_and_shrink_with_a_picture() -> None:
    looked = seen(standing())
    state = settled(looked, pictures=3)
    ahead = predicted(state, 0.1, SETTINGS)
    after = corrected(ahead, looked, 0.1, CAMERA, SETTINGS)
    for one in (state, ahead, after):
        assert np.linalg.eigvalsh(one.covariance).min() > 0.0
    assert np.linalg.eigvalsh(ahead.covariance - after.covariance).min() > -1e-6


@pytest.mark.parametrize("emotion", ["neutral", "angry"])
def test_a_frame_states_what_it_does_not_know(clips: list[RecordedClip], emotion: str) -> None:
    """Longest along the ray, as the settings say; across it the truth is within about as often as that says."""
    recorded, person = clip(clips, emotion, "B2"), CameraPerson()
    within = []
    for found, truth in zip(recorded.landmarks, recorded.joints, strict=True):
        frame = person.take(found)
        assert frame.names == MARKERS and frame.covariance is not None and frame.valid.all()
        for joint in range(len(JOINTS)):
            variances, axes = np.linalg.eigh(frame.covariance[joint])
            ray = frame.positions[joint] - person.camera_in_room
            assert variances[0] > 0.009**2 and variances[2] > 0.999 * SETTINGS.out_along**2
            if variances[2] > 1.1 * variances[1]:
                assert abs(axes[:, 2] @ ray) > 0.999 * np.linalg.norm(ray)
            gap = ray - TO_ROOM @ truth[joint]
            ray = TO_ROOM @ truth[joint] / np.linalg.norm(truth[joint])
            aside = gap - (gap @ ray) * ray
            within.append(aside @ np.linalg.solve(frame.covariance[joint], aside) < 9.2)  # 99 % of two dimensions
    assert np.mean(within) > 0.85


@pytest.mark.slow
def test_what_a_frame_states_is_true() -> None:
    """Raised arms of 18 other high fives, all joints: normalised squared errors and coverage, along the ray and across.

    Along it the errors of one high five hang together, so that there are hardly more than 18 of each joint: what is
    stated is wrong where 68 % are fewer than 55 or more than 85 %, or the deviation is off by a third.
    """
    along, across = [], []
    for recorded in load_clips(CHOICE):
        person = CameraPerson()
        for found, truth, frame in zip(recorded.landmarks, recorded.joints, recorded.frames, strict=True):
            made = person.take(found)
            if truth[WRIST, 1] > truth[SHOULDER, 1] + 0.25 or frame > recorded.contact_frame + 24:
                continue
            assert made.covariance is not None
            for joint in np.flatnonzero(made.valid[: len(JOINTS)]):
                place = TO_ROOM.T @ (made.positions[joint] - person.camera_in_room)
                stated, ray = TO_ROOM.T @ made.covariance[joint] @ TO_ROOM, place / np.linalg.norm(place)
                gap = place - truth[joint]
                along.append((gap @ ray) ** 2 / (ray @ stated @ ray))
                aside = gap - (gap @ ray) * ray
                across.append(aside @ aside / (0.5 * (np.trace(stated) - ray @ stated @ ray)))
    for squares, freedoms in ((np.array(along), 1), (np.array(across), 2)):
        assert 0.55 < squares.mean() / freedoms < 1.8
        assert 0.55 < np.mean(squares < chi2.ppf(0.68, freedoms)) < 0.85
        assert 0.88 < np.mean(squares < chi2.ppf(0.95, freedoms)) < 0.99


def test_left_and_right_exchanged_by_the_net_are_put_back(clips: list[RecordedClip]) -> None:
    recorded = clip(clips, "neutral", "B2")
    plain, guarded = CameraPerson(), CameraPerson()
    for number, found in enumerate(recorded.landmarks):
        assert found.picture is not None and found.visibility is not None and found.world is not None
        right = plain.take(found)
        turned = found
        if number % 3 == 1 and number > 3:
            turned = replace(
                found, picture=found.picture[_MIRROR], visibility=found.visibility[_MIRROR], world=found.world[_MIRROR]
            )
        back = guarded.take(turned)
        assert guarded.look is not None
        assert guarded.look.exchanged == (turned is not found)
        np.testing.assert_allclose(back.positions, right.positions, atol=1e-9)


@pytest.mark.parametrize("name", ["neutral", "angry"])
def test_a_left_hand_is_followed_as_a_right_one_is_in_a_mirror(clips: list[RecordedClip], name: str) -> None:
    recorded = clip(clips, name, "B2")
    right, left = CameraPerson(), CameraPerson(left=True)
    for found in recorded.landmarks:
        assert found.picture is not None and found.visibility is not None and found.world is not None
        turn = np.array([-1.0, 1.0, 1.0])
        turned = replace(
            found,
            picture=np.array([1.0, 0.0]) + turn[:2] * found.picture[_MIRROR],
            visibility=found.visibility[_MIRROR],
            world=turn * found.world[_MIRROR],
            hands=tuple(
                replace(hand, picture=np.array([1.0, 0.0]) + turn[:2] * hand.picture, world=turn * hand.world)
                for hand in found.hands
            ),
        )
        np.testing.assert_allclose(left.take(turned).positions, right.take(found).positions, atol=1e-9)
    empty = Landmarks(0, 0.0, 0.0, (1280, 720), 0, None, None, None)
    assert not CameraPerson(left=True).take(empty).valid.any()


@pytest.mark.parametrize("degrees", TILTED)
def test_a_camera_that_looks_up_or_down_sees_hands_where_they_are(degrees: int) -> None:
    """In the camera's own axes: the filter takes it for level, for neither net tells how it is tilted."""
    gaps = []
    for recorded in load_clips(TILTED[degrees]):
        person = CameraPerson()
        for found, truth, frame in zip(recorded.landmarks, recorded.joints, recorded.frames, strict=True):
            made = person.take(found)
            if truth[WRIST, 1] < truth[SHOULDER, 1] + 0.25 and frame < recorded.contact_frame + 24:
                gaps.append(TO_ROOM.T @ (made.positions[WRIST] - person.camera_in_room) - truth[WRIST])
    gaps = np.array(gaps)
    assert np.median(np.linalg.norm(gaps[:, :2], axis=1)) < 0.03
    assert np.median(np.abs(gaps[:, 2])) < 0.15


def test_somebody_elses_hand_is_not_hers(clips: list[RecordedClip]) -> None:
    found = clip(clips, "neutral", "B2").landmarks[0]
    alone = look(replace(found, hands=()), CAMERA, SETTINGS)
    hand = clip(clips, "neutral", "B2").landmarks[-1].hands[0]
    stranger = replace(hand, picture=np.tile([0.95, 0.2], (21, 1)))
    beside = look(replace(found, hands=(stranger,)), CAMERA, SETTINGS)
    assert alone is not None and beside is not None
    np.testing.assert_array_equal(alone.pixels, beside.pixels)
    assert beside.strangers == 1 and np.isnan(beside.hand_distance)


def test_nobody_in_the_picture_hides_all_and_somebody_new_is_begun_with(clips: list[RecordedClip]) -> None:
    recorded = clip(clips, "neutral", "B2")
    person = CameraPerson()
    assert person.take(recorded.landmarks[0]).valid.all()
    empty = Landmarks(0, 0.0, 0.0, (1280, 720), 0, None, None, None)
    seen_ms = recorded.landmarks[0].captured_ms
    shown = [person.take(replace(empty, captured_ms=seen_ms + 100.0 * n)).valid.any() for n in range(1, 10)]
    assert shown[0] and not shown[-1]  # for a moment she is predicted
    again = person.take(replace(recorded.landmarks[0], captured_ms=seen_ms + 5000.0))
    assert again.valid.all()


@pytest.mark.slow
def test_the_wrist_is_where_it_says(clips: list[RecordedClip]) -> None:
    """Raised hands of people on whom no setting was chosen: across the view 3 cm, with depth, its constant part aside,
    as docs/performance.md has it with some room."""
    gaps = []
    for recorded in clips:
        if recorded.cell in ("B2", "A1", "C3", "B1"):
            continue
        person = CameraPerson()
        for found, truth, frame in zip(recorded.landmarks, recorded.joints, recorded.frames, strict=True):
            made = person.take(found)
            if truth[WRIST, 1] < truth[SHOULDER, 1] + 0.25 and frame < recorded.contact_frame + 24:
                gaps.append(TO_ROOM.T @ (made.positions[WRIST] - person.camera_in_room) - truth[WRIST])
    gaps = np.array(gaps)
    assert len(gaps) > 100
    assert np.median(np.linalg.norm(gaps[:, :2], axis=1)) < 0.03
    assert np.median(np.abs(gaps[:, 2] - np.median(gaps[:, 2]))) < 0.10
