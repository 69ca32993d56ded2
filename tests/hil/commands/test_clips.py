"""Clips in an experiment: a lab's C3D files become what was acted, the tap starts them, and replays show them again."""

from collections.abc import Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import failing
from helpers.experiments import protocol, study
from helpers.virtual_stage import VirtualStage
from virtual_system import VirtualSystem

from highfive.hil.commands.clips import SIMULATED, TAP, load_clips, recorded_turn, shoulders, tapping
from highfive.hil.commands.experiment_stage import TAPPING
from highfive.hil.commands.shown_again import RecordedMotion, recorded_motion
from highfive.hil.experiments.stage import TrialBrokenOffError
from highfive.hil.experiments.trial_row import TrialRow
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.people.capture import AVATAR_SET, Defects, markers_of, record
from highfive.hil.sim.people.turning import turning
from highfive.hil.trials.live_partner import LivePerson, live_source
from highfive.hil.trials.partners import simulated_partner, simulated_partners
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

fails = failing("experiment", "run")
TIPPING = protocol("tipping")


@pytest.fixture
def clock() -> Iterator[VirtualClock]:
    with VirtualClock() as clock:
        yield clock


@pytest.mark.parametrize(
    ("style", "turned"),
    [("fearful", 2.0), *(pytest.param(*case, marks=pytest.mark.slow) for case in (("neutral", 0.0), ("angry", -1.0)))],
)
@pytest.mark.slow
def test_a_labs_recording_becomes_the_motion_that_was_acted(style: str, turned: float, tmp_path: Path) -> None:
    """Wherever in the room, and in whichever direction, the actor stood."""
    motion, worn = turning(style, np.random.default_rng(5)), load_marker_set(AVATAR_SET)
    rng = np.random.default_rng(1)
    points = rotations.rotate(rotations.from_axis_angle("z", turned), markers_of(motion, worn)) + np.array(
        [1.3, -0.7, 0.0]
    )
    recording = record([("actor:", points, worn)], Defects(0.0005, 0.02, (0.03, 0.2), 0.0), rng)
    write_c3d(tmp_path / "clip.c3d", recording)
    found, count = recorded_turn(tmp_path / "clip.c3d"), len(motion.root_in_world)
    assert abs(len(found.root_in_world) - count) <= 1
    rows = min(count, len(found.root_in_world))
    skeleton = motion.skeleton
    begin = motion.root_in_world[0] * [1.0, 1.0, 0.0]
    wanted, _ = skeleton.forward_kinematics(motion.root_in_world[:rows] - begin, motion.quaternions[:rows])
    got, _ = skeleton.forward_kinematics(found.root_in_world[:rows], found.quaternions[:rows])
    joints = [skeleton.index(name) for name in ("head", "right_wrist", "left_wrist", "right_shoulder", "pelvis")]
    away = np.linalg.norm(got[:, joints] - wanted[:, joints], axis=-1)
    assert np.median(away) < 0.03 and away.max() < 0.12, (np.median(away), away.max())


def test_a_folder_without_one_of_them_and_files_of_something_else_are_one_line(tmp_path: Path) -> None:
    with pytest.raises(HighFiveError, match=r"there is no .*neutral_1.c3d; a clip of each style and number"):
        load_clips(str(tmp_path), TIPPING)
    (tmp_path / "neutral_1.c3d").write_bytes(b"nothing")
    with pytest.raises(HighFiveError, match=r"neutral_1\.c3d"):
        load_clips(str(tmp_path), TIPPING)
    few = load_marker_set("paper")
    partner = simulated_partners(1, ("neutral",), ("B2",), 1)[0]
    assert few.names == partner.recording.names
    write_c3d(tmp_path / "neutral_1.c3d", partner.recording)
    with pytest.raises(HighFiveError, match=r"neutral_1\.c3d: it shows no pelvis and no hip"):
        load_clips(str(tmp_path), TIPPING)


def shown(run: VirtualStage, row: TrialRow) -> RecordedMotion:
    return recorded_motion(run.folder / row.recording, f"{row.trial}, asked as {row.ask}")


@pytest.mark.slow
def test_the_back_is_shown_until_the_tap_then_the_clip_and_a_replay_shows_both_again(
    clock: VirtualClock, tmp_path: Path
) -> None:
    clips = load_clips(SIMULATED, TIPPING)
    assert len(clips) == 12
    with ExitStack() as stack:
        run = VirtualStage(clock, stack, tmp_path, template="tipping", clips=clips)
        first = run.play("I1", "interactive", 1, style="fearful", clip=2, cell="")
        angry = run.play("I2", "interactive", 2, style="angry", clip=1, cell="")
        again = run.play("R1", "own_replay", 3, first, style="fearful", clip=2, cell="")
        assert run.stage.shown_ns() is None  # pages tell some pictures later, while she answers
        run.page.tells = True
        tap_ns = run.stage.shown_ns()
        run.stage.close()
        acted, watched, near = shown(run, first), shown(run, again), shown(run, angry)
    skeleton = avatar_skeleton()
    positions, _ = skeleton.forward_kinematics(near.poses[-1].root_in_world[None], near.poses[-1].quaternions[None])
    head = positions[0, skeleton.index("head")]
    assert 0.35 < np.linalg.norm(head - near.people[-1].head_position) < 0.8  # a face, and not the inside of a head
    assert again.contact_ns is not None and tap_ns is not None and again.ended_ns is not None
    assert again.contact_ns <= tap_ns < again.contact_ns + 10**8 < again.ended_ns  # the tap, as it is shown again
    clip = clips["fearful", 2]
    at = shoulders(clip.poses[0])
    distance = np.array([np.linalg.norm(at - person.palm.position, axis=1).min() for person in acted.people])
    tapped = int(np.argmax(distance < TAP))
    assert tapped > 30 and first.contact_ns is not None
    for row in range(0, tapped, 10):  # recordings are rounded
        assert np.abs(acted.poses[row].hinges - clip.poses[0].hinges).max() < 1e-3
    for row in range(tapped, len(acted.poses), 5):
        wanted = clip.poses[min(row - tapped, len(clip.poses) - 1)]
        assert np.abs(acted.poses[row].hinges - wanted.hinges).max() < 1e-3
    assert len(acted.poses) - tapped == pytest.approx(len(clip.poses), abs=2)
    assert abs(int(watched.times_ns[-1] - acted.times_ns[-1])) < 20_000_000
    for row in range(0, len(watched.poses), 9):
        wanted, _ = acted.at(int(watched.times_ns[row]))
        assert np.abs(watched.poses[row].hinges - wanted.hinges).max() < 1e-3


@pytest.mark.slow
def test_every_simulated_person_reaches_the_shoulder_that_she_taps() -> None:
    clips = load_clips(SIMULATED, TIPPING)
    for seed, clip in enumerate(clips.values()):
        shoulder = shoulders(clip.poses[0])[0]
        partner = simulated_partner("neutral", TAPPING, 0, np.random.default_rng([0, seed]))
        taps = tapping(partner, shoulder)
        assert taps.palm is not None
        assert np.nanmin(np.linalg.norm(taps.palm - shoulder, axis=1)) < 0.5 * TAP
        moved = taps.recording.points - partner.recording.points  # she stands elsewhere: nothing else changes
        assert np.ptp(moved[taps.recording.valid], axis=0).max() < 1e-9


@pytest.mark.slow(15)
def test_a_live_person_taps_and_one_who_does_not_is_broken_off(clock: VirtualClock, tmp_path: Path) -> None:
    clips = load_clips(SIMULATED, TIPPING)
    recording = simulated_partners(1, ("neutral",), ("B3",), 3)[0].recording
    for name, served, taps in (("taps", recording, True), ("stands", recording, False)):
        if not taps:  # as she stands first
            points, valid = served.points[:1].repeat(240, axis=0), served.valid[:1].repeat(240, axis=0)
            served = replace(  # noqa: PLW2901
                served, points=points, valid=valid, unlabelled=np.zeros((240, 0, 3)),
                unlabelled_valid=np.zeros((240, 0), dtype=bool),
            )  # fmt: skip
        system = VirtualSystem(clock, recording)
        with ExitStack() as stack:
            source = stack.enter_context(closing(live_source("vicon://lab", None, system.wiring)))
            person = LivePerson(source, "vicon://lab", clock=clock)
            if not taps:
                source = stack.enter_context(
                    closing(live_source("vicon://lab", None, VirtualSystem(clock, served).wiring))
                )
                person = LivePerson(source, "vicon://lab", None, person.placement, clock)
            run = VirtualStage(clock, stack, tmp_path / name, person, template="tipping", clips=clips)
            if taps:
                row = run.play("I1", "interactive", 1, style="angry", clip=3, cell="")
                assert row.contact_ns is not None
            else:
                with pytest.raises(TrialBrokenOffError, match=r"was not tapped|it took longer"):
                    run.play("I1", "interactive", 1, style="angry", clip=3, cell="")


def test_clips_go_with_an_experiment_that_shows_some_and_no_arm(fails, tmp_path: Path) -> None:
    (tmp_path / "acts").mkdir()
    clips, acts = study(tmp_path), study(tmp_path / "acts", "morph", {"participants = 16": "participants = 1"})
    for folder, words, says in (
        (clips, (), "give --clips DIR with neutral_1.c3d and so on, or --clips simulated"),
        (acts, ("--clips", "simulated"), "shows no clips: leave out --clips"),
        (clips, ("--clips", "simulated", "--rig", "emulated"), "leave out --rig"),
        (clips, ("--clips", tmp_path / "absent"), "a clip of each style and number is needed"),
    ):
        assert says in fails("--study", folder, "--participant", "P01", "--consent", "1", "--no-open", *words)
    assert not list(tmp_path.rglob("trials.jsonl"))
