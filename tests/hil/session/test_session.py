"""The chain from markers to pose: inside the limits, smooth whatever happens, calm with strangers, always the same."""

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.session.reach import Phase
from highfive.hil.session.session import RATE_HZ, PoseSettings, Session, Tick
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.hil.sim.scene import Scene
from highfive.hil.trials.partners import Partner, simulated_partners
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.trained import HGPDM

EMOTIONS = ("neutral", "angry")
HIDDEN = 0.3  # s, the longest occlusion of a hand that a high five goes on through


@pytest.fixture(scope="module")
def partners() -> dict[str, Partner]:
    return dict(zip(EMOTIONS, simulated_partners(2, EMOTIONS, ("B2",), 3), strict=True))


@pytest.fixture(scope="module")
def frames(partners: dict[str, Partner]) -> dict[str, list[MarkerFrame]]:
    return {emotion: list(C3DSource(partner.recording)) for emotion, partner in partners.items()}


@pytest.fixture(scope="module")
def start(model: HGPDM, scene: Scene, partners: dict[str, Partner]) -> Callable[[str], Session]:
    return lambda emotion: Session(model, {emotion: 1.0}, partners[emotion].marker_set, scene)


@pytest.fixture(scope="module")
def undisturbed(start: Callable[[str], Session], frames: dict[str, list[MarkerFrame]]) -> dict[str, list[Tick]]:
    return {emotion: run(start(emotion), frames[emotion]) for emotion in EMOTIONS}


def run(session: Session, frames: Iterable[MarkerFrame]) -> list[Tick]:
    return [session.step(frame) for frame in frames]


def hinges(ticks: Iterable[Tick]) -> np.ndarray:
    return np.array([tick.pose.hinges for tick in ticks])


def speed_change(ticks: Iterable[Tick]) -> float:
    """Largest change of any hinge's speed from tick to tick, rad/s."""
    return float(np.abs(np.diff(hinges(ticks), n=2, axis=0)).max() * RATE_HZ)


def without(frame: MarkerFrame, names: Iterable[str]) -> MarkerFrame:
    """The frame without some markers, and without ghosts that could be taken for them."""
    gone = np.isin(frame.names, list(names))
    positions = np.where(gone[:, None], 0.0, frame.positions)
    return replace(frame, positions=positions, valid=frame.valid & ~gone, unlabelled=np.zeros((0, 3)))


def assert_inside_limits(poses: Iterable[Pose]) -> None:
    angles, limits = np.array([pose.hinges for pose in poses]), avatar_skeleton().hinge_limits
    assert np.all(np.isfinite(angles))
    assert np.all(angles >= limits[..., 0] - 1e-9) and np.all(angles <= limits[..., 1] + 1e-9)


def test_every_hinge_of_every_pose_is_inside_its_limits(undisturbed: dict[str, list[Tick]]) -> None:
    for ticks in undisturbed.values():
        assert_inside_limits(tick.pose for tick in ticks)
        assert_inside_limits(tick.generated for tick in ticks)


def test_the_palm_meets_the_hand_that_is_raised(undisturbed: dict[str, list[Tick]]) -> None:
    for ticks in undisturbed.values():
        phases = [tick.target.phase for tick in ticks]
        assert list(dict.fromkeys(phases)) == [Phase.IDLE, Phase.APPROACH, Phase.TOUCH, Phase.RELEASE]
        touching = [tick for tick in ticks if tick.target.phase is Phase.TOUCH]
        assert min(np.linalg.norm(t.palm.position - t.person.palm.position) for t in touching) < 1e-3
        assert not any(tick.out_of_reach for tick in touching)


def test_two_sessions_and_a_session_used_again_give_the_same_bits(
    start: Callable[[str], Session], frames: dict[str, list[MarkerFrame]], undisturbed: dict[str, list[Tick]]
) -> None:
    session = start("angry")
    session.set_style({"neutral": 1.0})
    run(session, frames["angry"][:150])  # another style, another person, and a trial that was not finished
    session.set_style({"angry": 1.0})
    session.reset()
    again = run(session, frames["angry"])
    np.testing.assert_array_equal(hinges(again), hinges(undisturbed["angry"]))
    for ours, theirs in zip(again, undisturbed["angry"], strict=True):
        np.testing.assert_array_equal(ours.pose.root_in_world, theirs.pose.root_in_world)


@pytest.mark.slow
def test_a_style_changed_on_the_way_makes_no_jump(
    start: Callable[[str], Session], frames: dict[str, list[MarkerFrame]], undisturbed: dict[str, list[Tick]]
) -> None:
    session = start("neutral")
    contact = next(i for i, tick in enumerate(undisturbed["neutral"]) if tick.target.phase is Phase.TOUCH)
    before = run(session, frames["neutral"][: contact - 40])
    session.set_style({"angry": 1.0})
    after = run(session, frames["neutral"][contact - 40 :])
    assert speed_change(before + after) < 1.5 * max(speed_change(ticks) for ticks in undisturbed.values())
    different = np.abs(hinges(before + after) - hinges(undisturbed["neutral"])).max(axis=(1, 2))
    assert different[: contact - 40].max() == 0.0
    assert different.max() > np.radians(3.0)  # the change of style does change the motion


@pytest.mark.parametrize("emotion", EMOTIONS)
@pytest.mark.parametrize(
    "before_contact", [0.2, *(pytest.param(seconds, marks=pytest.mark.slow) for seconds in (0.5, 0.0))]
)
@pytest.mark.slow
def test_a_hand_hidden_for_a_while_makes_no_jump(
    start: Callable[[str], Session],
    frames: dict[str, list[MarkerFrame]],
    partners: dict[str, Partner],
    undisturbed: dict[str, list[Tick]],
    before_contact: float,
    emotion: str,
) -> None:
    usual, arm = undisturbed[emotion], partners[emotion].marker_set.arm
    contact = next(i for i, tick in enumerate(usual) if tick.target.phase is Phase.TOUCH)
    first = contact - round(before_contact * RATE_HZ)
    hidden, hand = range(first, first + round(HIDDEN * RATE_HZ)), {*arm.hand, *arm.wrist}
    ticks = run(start(emotion), (without(f, hand) if i in hidden else f for i, f in enumerate(frames[emotion])))
    assert not any(t.markers.seen[[t.markers.names.index(n) for n in hand]].any() for t in ticks[first : hidden.stop])
    assert_inside_limits(tick.pose for tick in ticks)
    assert speed_change(ticks) < 2.0 * speed_change(usual)
    again = slice(hidden.stop + 60, None)  # half a second later it is as if nothing had been
    for ours, theirs in zip(ticks[again], usual[again], strict=True):
        assert np.linalg.norm(ours.person.palm.position - theirs.person.palm.position) < 2e-3


@pytest.mark.slow
def test_settings_bound_the_pose_s_speed_and_delay_it(
    model: HGPDM,
    scene: Scene,
    partners: dict[str, Partner],
    frames: dict[str, list[MarkerFrame]],
    undisturbed: dict[str, list[Tick]],
) -> None:
    def generated(settings: PoseSettings) -> np.ndarray:
        session = Session(model, {"angry": 1.0}, partners["angry"].marker_set, scene, correct=False, settings=settings)
        return np.array([tick.generated.hinges for tick in run(session, frames["angry"])])

    usual = np.array([tick.generated.hinges for tick in undisturbed["angry"]])
    np.testing.assert_array_equal(generated(PoseSettings()), usual)
    fastest = np.abs(np.diff(usual, axis=0)).max() * RATE_HZ
    assert fastest > 4.0  # rad/s
    bounded = generated(PoseSettings(quickest=2.0))
    assert np.abs(np.diff(bounded, axis=0)).max() * RATE_HZ < 0.75 * fastest
    calmer = generated(PoseSettings(calming=2.0))
    half = slice(round(0.5 * RATE_HZ))  # s, within which the usual avatar leaves the pose in which it waits
    assert np.abs(calmer - usual[0])[half].max() < np.abs(usual - usual[0])[half].max()


def test_a_sighting_is_the_person_at_the_frame_s_own_time(
    start: Callable[[str], Session], frames: dict[str, list[MarkerFrame]], undisturbed: dict[str, list[Tick]]
) -> None:
    late = 25_000_000
    session, ticks = start("angry"), []
    for frame in frames["angry"]:
        ticks.append(session.step(frame, frame.source_time_ns + late))
    assert session.step(None, ticks[-1].time_ns + late).sighting is None
    ahead = []
    for frame, tick, now in zip(frames["angry"], ticks, undisturbed["angry"], strict=True):
        assert tick.sighting is not None and now.sighting is not None
        assert tick.sighting.markers.time_ns == frame.source_time_ns == tick.time_ns - late
        # However far the tick is ahead, what was seen is the same, to the bit.
        np.testing.assert_array_equal(tick.sighting.markers.positions, now.sighting.markers.positions)
        np.testing.assert_array_equal(tick.sighting.person.wrist, now.sighting.person.wrist)
        ahead.append(np.linalg.norm(tick.person.wrist - tick.sighting.person.wrist))
    assert max(ahead) > 0.02  # m: a hand that is quick


@pytest.mark.slow
def test_a_stranger_far_away_is_met_with_calm(
    start: Callable[[str], Session], frames: dict[str, list[MarkerFrame]]
) -> None:
    session = start("neutral")
    nobody = [without(frame, frame.names) for frame in frames["neutral"]]
    calm = run(session, nobody)
    assert np.abs(hinges(calm) - calm[0].pose.hinges).max() < np.radians(0.5)
    session.reset()
    # Two metres behind where a person stands, and walking about there.
    times = np.arange(len(nobody)) / RATE_HZ
    rng = np.random.default_rng(0)
    waves = rng.normal(size=(3, 3)), rng.uniform(1.0, 4.0, 3)
    wander = [2.0, 1.0, 0.0] + 0.3 * np.sin(times[:, None] * waves[1]) @ waves[0]
    far = [replace(f, positions=f.positions + step) for f, step in zip(frames["neutral"], wander, strict=True)]
    ticks = run(session, far)
    assert all(tick.person.valid for tick in ticks[30:])
    assert {tick.target.phase for tick in ticks} == {Phase.IDLE}
    assert np.abs(hinges(ticks) - calm[0].pose.hinges).max() < np.radians(1.0)


def test_a_model_of_another_skeleton_is_refused_in_one_line(
    model: HGPDM, scene: Scene, partners: dict[str, Partner]
) -> None:
    marker_set = partners["neutral"].marker_set
    with pytest.raises(HighFiveError, match=f"0123abcd.*{avatar_skeleton().hash}.*train") as error:
        Session(replace(model, skeleton_hash="0123abcd"), {"neutral": 1.0}, marker_set, scene)
    assert "\n" not in str(error.value)


def test_a_style_that_the_model_does_not_know_is_refused_in_one_line(start: Callable[[str], Session]) -> None:
    for style in ({"bored": 1.0}, {"angry": 0.5, "neutral": 0.4}):
        with pytest.raises(HighFiveError) as error:
            start("neutral").set_style(style)
        assert "\n" not in str(error.value)
