"""The time to contact is said where it can be said, and a recording keeps where that was."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from highfive.hil.recording.recorded_tick import recorded_tick
from highfive.hil.recording.recorder import SessionRecorder, TrialHead
from highfive.hil.session.contact_time import SURE_S, sure_contact_s
from highfive.hil.session.reach import Phase
from highfive.hil.session.session import Session, Tick, TickInput
from highfive.hil.sim.playout import KinematicPlayOut, PlayState
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import simulated_person
from highfive.hil.trials.summary import SessionSettings
from highfive.hil.trials.trial import run_trial
from highfive.hil.view.recorded import recorded_trials
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model
from highfive.model.online.contact_forecast import ContactForecast
from highfive.model.online.reaction import SimpleReaction

NONE = np.zeros(3)
REACTION = SimpleReaction(np.zeros(159), NONE, NONE, NONE, 0.4, 0.1)


def forecast(time: float, deviation: float) -> ContactForecast:
    covariance = np.diag([1e-4, 1e-4, 1e-4, deviation**2])
    return ContactForecast(NONE, time, covariance)


def test_it_is_said_only_while_somebody_reaches_as_people_do_and_is_known_well_enough() -> None:
    assert [sure_contact_s(REACTION, phase) for phase in Phase] == [None, 0.4, 0.4, None]
    assert sure_contact_s(replace(REACTION, in_distribution=False), Phase.APPROACH) is None
    assert sure_contact_s(replace(REACTION, time_to_contact_std=1.01 * SURE_S), Phase.APPROACH) is None
    surer = replace(REACTION, time_to_contact_std=9.0, contact=forecast(0.3, 0.99 * SURE_S))
    assert sure_contact_s(surer, Phase.APPROACH) == 0.3  # the forecast's, not the clock's
    assert sure_contact_s(replace(surer, contact=forecast(0.3, 1.01 * SURE_S)), Phase.APPROACH) is None


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray, np.ndarray, float]:
    """A recording, the times that its page was told, the palm's speed, m/s, and when palms met, s."""
    path = tmp_path_factory.mktemp("contact") / "session.mcap"
    person, scene = simulated_person("neutral", "B2"), build_scene()
    session = Session(load_model(DEFAULT_MODEL), {"neutral": 1.0}, person.marker_set, scene)
    told: list[float] = []
    speeds: list[float] = []
    with SessionRecorder(path, SessionSettings(seed=0, model="default", trials=1), session.chain) as recorder:
        recorder.begin_trial(TrialHead(0, person, "neutral", session.weights))

        def keep(begins: TickInput, tick: Tick, state: PlayState, tick_ms: float) -> None:
            said = sure_contact_s(tick.response, tick.target.phase)
            told.append(np.nan if said is None else said)
            speeds.append(float(np.linalg.norm(tick.person.palm.velocity)))
            recorder.record_tick(recorded_tick(begins, tick, state.pose, tick_ms))

        result = run_trial(0, person, session, KinematicPlayOut(scene), keep=keep)
        recorder.end_trial(result)
    return path, np.array(told), np.array(speeds), result.contact_time


def test_nothing_is_said_while_nobody_moves_and_what_is_said_comes_true(
    played: tuple[Path, np.ndarray, np.ndarray, float],
) -> None:
    _, told, speeds, contact_s = played
    moves = int(np.argmax(speeds > 0.1))
    assert moves > 30 and np.isnan(told[:moves]).all()
    left = contact_s - np.arange(len(told)) / 120.0
    before = ~np.isnan(told) & (left > 0.0)
    assert before.sum() > 30
    assert np.abs(told - left)[before].max() < SURE_S
    assert np.isnan(told[left < -0.35]).all()


def test_a_recording_says_what_its_session_said_and_one_of_before_what_its_forecasts_say(
    played: tuple[Path, np.ndarray, np.ndarray, float], tmp_path: Path
) -> None:
    path, told, speeds, _ = played
    scene = build_scene()
    np.testing.assert_allclose(recorded_trials(path, scene)[0].expected, told, atol=1e-5)
    older = tmp_path / "older.mcap"
    with path.open("rb") as file, older.open("wb") as out:
        writer = Writer(out)
        writer.start(profile="", library="test")
        channels: dict[str, int] = {}
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert schema is not None
            data = message.data
            if channel.topic == "/tick":
                data = json.dumps({k: v for k, v in json.loads(data).items() if k != "sure"}).encode()
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(channels[channel.topic], message.log_time, data, message.publish_time)
        writer.finish()
    found = recorded_trials(older, scene)[0].expected
    known = ~np.isnan(told)
    np.testing.assert_allclose(found[known], told[known], atol=1e-5)
    assert np.isnan(found[: int(np.argmax(speeds > 0.1))]).all()
