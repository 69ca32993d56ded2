"""Recordings on the page: every body where it was, at any speed, and what cannot be shown said in one line."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from scipy.interpolate import CubicSpline

from highfive.hil.recording.recording import read_recording
from highfive.hil.recording.session_reader import read_session
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.scene import build_scene
from highfive.hil.view import SHIPPED_RECORDING
from highfive.hil.view.cast import Cast
from highfive.hil.view.commands import Command
from highfive.hil.view.player import AHEAD_S, REST_S, Player, along, trial_line
from highfive.hil.view.recorded import RecordedTrials, recorded_trials
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations


@cache
def shipped() -> RecordedTrials:
    return recorded_trials(SHIPPED_RECORDING, build_scene())


@pytest.mark.slow
def test_the_shipped_recording_is_small_and_has_every_emotion() -> None:
    assert SHIPPED_RECORDING.stat().st_size < 1_000_000
    assert sorted(trial.style for trial in shipped()) == ["angry", "happy", "neutral", "sad"]
    for trial in shipped():
        assert trial.contact["met"] and trial.contact_s is not None
        assert 0.5 < trial.contact_s < trial.times[-1] - 0.3
        at = int(np.searchsorted(trial.times, trial.contact_s))
        assert trial.palms[at] < 0.02 and trial.palms[0] > 0.3


def test_bodies_are_where_forward_kinematics_has_them() -> None:
    recording, trial, skeleton = read_recording(SHIPPED_RECORDING), shipped()[0], avatar_skeleton()
    _, poses = recording.poses()
    names = Cast.of(build_scene().model).names
    for tick in range(0, len(trial.times), 40):
        positions, turns = skeleton.forward_kinematics(poses[tick].root_in_world, poses[tick].quaternions)
        assert np.allclose(trial.bodies[tick, : len(skeleton), :3], positions, atol=1e-6)
        assert np.allclose(np.abs((trial.bodies[tick, : len(skeleton), 3:] * turns).sum(axis=1)), 1.0, atol=1e-6)
        head = trial.bodies[tick, names.index("person_head")]
        said = recording.channels["/person"][tick].data
        assert np.linalg.norm(head[:3] - said["head"]) < 0.2


def test_a_contact_is_drawn_only_where_its_time_is_told() -> None:
    for trial in shipped():
        drawn = np.array([forecast is not None for forecast in trial.forecasts])
        assert drawn.any() and not np.isnan(trial.expected[drawn]).any()


@pytest.mark.slow
def test_the_time_to_contact_is_told_only_where_it_is_right() -> None:
    """Before the hand is raised, and after it is back, the model has a time all the same, of 0.7 s."""
    for trial in shipped():
        told = np.isfinite(trial.expected)
        assert trial.contact_s is not None and told.sum() >= 10
        assert np.abs(trial.expected[told] - (trial.contact_s - trial.times[told])).max() < 0.3


def test_the_forecast_closes_in_on_where_palms_meet() -> None:
    for trial in shipped():
        assert trial.contact_s is not None
        before = [i for i, forecast in enumerate(trial.forecasts) if forecast and trial.times[i] < trial.contact_s]
        first, last = trial.forecasts[before[0]], trial.forecasts[before[-1]]
        assert first is not None and last is not None
        np.testing.assert_allclose(last["point"], trial.contact["where"], atol=0.05)
        sure, unsure = (np.linalg.norm(one["axes"], axis=1).max() for one in (last, first))
        assert 0.0 < sure < 0.5 * unsure
        player = Player([trial])
        player.obey(Command("seek", float(trial.times[before[-1]])))
        assert player.state()["forecast"] is last


def test_it_goes_on_by_the_clock_at_its_speed_and_from_trial_to_trial() -> None:
    player = Player(shipped())
    for _ in range(60):
        player.advance(1 / 120)
    assert player.time_s == pytest.approx(0.5)
    player.obey(Command("speed", 0.25))
    for _ in range(120):
        player.advance(1 / 120)
    assert player.time_s == pytest.approx(0.75)
    message = player.poses(7)
    assert (message.rate, message.holds_ns, message.time_s) == (0.25, 7, player.time_s)
    player.obey(Command("seek", 1e6))
    assert player.time_s == shipped()[0].times[-1] and player.poses(0).rate == 0.0
    player.advance(0.9 * REST_S)
    assert player.trial == 0
    player.advance(0.2 * REST_S)
    assert (player.trial, player.time_s) == (1, 0.0)
    player.obey(Command("trial", 99))
    assert player.trial == len(shipped()) - 1
    player.obey(Command("next"))
    assert player.trial == 0
    for name in ("style", "cell", "correct", "estop"):
        player.obey(Command(name, {}))


def test_steps_are_ticks_and_stand_still() -> None:
    player, times = Player(shipped()), shipped()[0].times
    player.obey(Command("seek", float(times[30])))
    for step, at in ((1, 31), (1, 32), (-1, 31), (-100, 0), (10_000, len(times) - 1)):
        player.obey(Command("step", step))
        assert player.time_s == times[at] and not player.playing
        assert np.allclose(player.poses(0).bodies, shipped()[0].bodies[at], atol=1e-9)
        player.advance(1.0)
        assert player.time_s == times[at]
    assert player.poses(0).rate == 0.0
    player.obey(Command("pause", False))
    player.obey(Command("again"))
    player.advance(0.1)
    assert player.time_s == pytest.approx(0.1)


def test_between_two_ticks_turns_go_the_short_way_and_places_along_a_parabola() -> None:
    times = np.array([0.0, 0.1, 0.2, 0.4])
    angles = 0.2 + 2.0 * times
    turns = np.array([rotations.from_axis_angle("z", float(angle)) for angle in angles])
    turns[2] *= -1.0
    places = np.stack([1.0 + times, 2.0 * times**2, np.zeros(4)], axis=1)
    bodies = np.concatenate([places, turns], axis=1)[:, None]
    half = along(times, bodies, 1, 0.5)[0]
    assert np.allclose(half[:2], [1.15, 2.0 * 0.15**2], atol=0.003) and half[2] == 0.0
    assert abs(half[3:] @ rotations.from_axis_angle("z", 0.5)) == pytest.approx(1.0, abs=1e-6)
    even = along(
        np.arange(4) / 60.0, np.concatenate([np.arange(4)[:, None] ** 2 * np.ones((4, 3)), turns], 1)[:, None], 1, 0.25
    )
    assert np.allclose(even[0, :3], 1.25**2)  # on equal steps exactly
    for first in (0, 2):
        assert np.allclose(along(times, bodies, first, 0.0)[0, :3], places[first])
        assert np.allclose(along(times, bodies, first, 1.0)[0, :3], places[first + 1])


def test_poses_are_sent_ahead_but_where_the_time_has_leapt() -> None:
    """For which the page is to forget what it was sent: a message for no later time than the one before says so."""
    player, trial = Player(shipped()), shipped()[0]
    curve = CubicSpline(trial.times, trial.bodies[:, 10, :3])
    first = player.poses(1_000)
    assert (first.holds_ns, first.time_s) == (1_000, 0.0)
    for count in range(1, 60):
        player.advance(1 / 120)
        message = player.poses(round(1e9 * count / 120))
        assert message.holds_ns == round(1e9 * count / 120) + round(1e9 * AHEAD_S)
        assert message.time_s == pytest.approx(count / 120 + AHEAD_S)
        np.testing.assert_allclose(message.bodies[10, :3], curve(message.time_s), atol=1e-3)
    assert player.state()["time_s"] == pytest.approx(59 / 120)
    for command in (Command("seek", 1.0), Command("speed", 0.5), Command("next"), Command("pause", True)):
        player.obey(command)
        leapt = player.poses(500_000_000)
        assert leapt.holds_ns == 500_000_000 and leapt.time_s == player.time_s, command
    player.obey(Command("pause", False))
    player.poses(0)
    player.obey(Command("speed", 1.0))
    player.obey(Command("seek", float(shipped()[1].times[-1]) - 0.02))
    player.poses(0)
    player.advance(0.008)
    last = player.poses(8_000_000)  # the end is 12 ms away: it is sent, and is still to come
    assert last.time_s == shipped()[1].times[-1] and last.rate == 1.0 and last.holds_ns > 8_000_000
    player.advance(0.1)
    assert player.poses(108_000_000).rate == 0.0


def test_a_recording_that_was_cut_short_is_shown_up_to_there(tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    whole = SHIPPED_RECORDING.read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    found = recorded_trials(cut, build_scene())
    assert 1 <= len(found) < len(shipped()) and np.array_equal(found[0].bodies, shipped()[0].bodies)
    cut.write_bytes(whole[: int(0.1 * len(whole))])  # not one whole chunk
    with pytest.raises(HighFiveError, match="not the recording of a session") as said:
        recorded_trials(cut, build_scene())
    assert "\n" not in str(said.value)


def shipped_with(path: Path, change: Callable[[str, int, bytes], bytes | None]) -> Path:
    """The shipped recording with messages changed, or left out where None is made of them: by topic and high five."""
    with SHIPPED_RECORDING.open("rb") as file, path.open("wb") as out:
        writer = Writer(out)
        writer.start(profile="", library="test")
        channels: dict[str, int] = {}
        high_five = -1
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            high_five += channel.topic == "/trial"
            data = change(channel.topic, high_five, message.data)
            if data is None or schema is None:
                continue
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(channels[channel.topic], message.log_time, data, message.publish_time)
        writer.finish()
    return path


@pytest.mark.slow
def test_a_recording_of_a_version_without_markers_is_shown_without_them(tmp_path: Path) -> None:
    older = shipped_with(tmp_path / "older.mcap", lambda topic, _, data: None if topic == "/markers" else data)
    found = recorded_trials(older, build_scene())
    assert len(found) == len(shipped()) and np.array_equal(found[1].bodies, shipped()[1].bodies)
    assert found[1].markers.shape[1] == 0 and Player(found).state()["markers"] == 0


def test_a_high_five_of_which_a_part_was_not_recorded_is_named(tmp_path: Path) -> None:
    def third_without(topic: str, high_five: int, data: bytes) -> bytes | None:
        return None if (topic, high_five) == ("/person", 2) else data

    found = recorded_trials(shipped_with(tmp_path / "one.mcap", third_without), build_scene())
    assert found.lacking == {2: "/person not recorded"} and [span.number for span in found.spans] == [0, 1, 3]
    none = shipped_with(tmp_path / "none.mcap", lambda topic, _, data: None if topic == "/person" else data)
    with pytest.raises(HighFiveError, match="no high five that can be shown: /person not recorded"):
        recorded_trials(none, build_scene())


def test_a_damaged_high_five_is_passed_over_and_named(tmp_path: Path) -> None:
    def third_damaged(topic: str, high_five: int, data: bytes) -> bytes:
        return json.dumps({"root": "far", "quaternions": []}).encode() if (topic, high_five) == ("/avatar", 2) else data

    found = recorded_trials(shipped_with(tmp_path / "damaged.mcap", third_damaged), build_scene())
    player = Player(found)
    player.obey(Command("trial", 2))
    assert player.trial == 3 and list(player.damaged) == [2] and "high five 3 lacks" in player.damaged[2]
    player.obey(Command("next"))
    assert player.trial == 0


def test_a_recording_whose_first_high_five_is_damaged_begins_with_the_next(tmp_path: Path) -> None:
    def damaged(topic: str, high_five: int, data: bytes) -> bytes:
        return b'{"root": "far", "quaternions": []}' if topic == "/avatar" and high_five == 0 else data

    player = Player(recorded_trials(shipped_with(tmp_path / "first.mcap", damaged), build_scene()))
    assert player.trial == 1 and list(player.damaged) == [0]


def test_the_list_has_what_the_session_showed_of_a_contact() -> None:
    """On its own page it was from the true palm, which of a person who lives nobody knows."""
    span = read_session(SHIPPED_RECORDING)[0].span
    for known, shown in (({"touch_error": 0.002}, 0.002), ({"touch_error": None}, 1e-5), ({}, 1e-5)):
        assert trial_line(replace(span, contact={"met": True, "distance": 1e-5, **known}))["distance_m"] == shown


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joints": ["a", "b"]}, "recorded with another skeleton"),
        ({"person": {"palm": [0, 0, 0]}}, "recording of another version"),
        ({"avatar": {"root": "far", "quaternions": []}}, "recording of another version"),
        ({}, "holds no high five"),
    ],
)
def test_what_cannot_be_shown_is_said_in_one_line(change: dict[str, object], message: str, tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    write_other(path, change)
    with pytest.raises(HighFiveError, match=message) as found:
        recorded_trials(path, build_scene())
    assert "\n" not in str(found.value)


def write_other(path: Path, change: dict[str, object]) -> None:
    """A recording of the shipped one's first ticks, with something else in it."""
    recording = read_recording(SHIPPED_RECORDING)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="test")
        about = {"settings": {}, "joints": change.get("joints", recording.joints)}
        rows = [("/session", 0, about)]
        if change and "joints" not in change:
            for topic in ("/person", "/avatar", "/tick"):
                for message in recording.channels[topic][:5]:
                    data = change.get(topic[1:], message.data)
                    rows.append((topic, message.time_ns, data))  # pyright: ignore[reportArgumentType]
        channels: dict[str, int] = {}
        for topic, time_ns, data in rows:
            if topic not in channels:
                schema = writer.register_schema(topic, "jsonschema", b"{}")
                channels[topic] = writer.register_channel(topic, "json", schema)
            writer.add_message(channels[topic], time_ns, json.dumps(data).encode(), time_ns)
        writer.finish()
