"""Somebody changes the style while a high five is played: it is called by the one in which palms met."""

from pathlib import Path

import pytest

from highfive.hil.bench.live_people import parts, people
from highfive.hil.commands.play_trials import Kept
from highfive.hil.publish.outputs import SessionOutputs
from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.recorder import SessionRecorder, TrialHead
from highfive.hil.recording.recording import read_recording
from highfive.hil.session.session import Session, Tick, TickInput
from highfive.hil.sim.playout import KinematicPlayOut, PlayState
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.summary import SessionSettings
from highfive.hil.trials.trial import run_trial


@pytest.fixture(scope="module")
def person() -> Partner:
    return people(("happy",), ("B2",), 1, lambda *_: lambda *_, **__: None)[0]


@pytest.mark.slow
@pytest.mark.parametrize(("late", "called"), [(-30, "angry"), (30, "happy")])
def test_it_is_called_by_the_style_in_which_palms_met(person: Partner, late: int, called: str, tmp_path: Path) -> None:
    """Changed a quarter of a second before, or after."""
    model, scene = parts()
    session = Session(model, {"happy": 1.0}, person.marker_set, scene)
    head = TrialHead(0, person, "happy", session.weights, session.corrects, paced=False)
    file = SessionRecorder(tmp_path / "session.mcap", SessionSettings(seed=1, model="default", trials=1), session.chain)
    with SessionOutputs(BackgroundRecorder(file, paced=False)) as recorder:
        kept, ticks = Kept(recorder, head, None, session, None), 0

        def keep(begins: TickInput, tick: Tick, state: PlayState, tick_ms: float) -> None:
            nonlocal ticks
            if ticks == person.contact_frame + late:
                session.set_style({"angry": 1.0})
            ticks += 1
            kept(begins, tick, state, tick_ms)

        run_trial(0, person, session, KinematicPlayOut(scene), keep=keep)
        recorder.end()
    events = [message.data for message in read_recording(tmp_path / "session.mcap").channels["/event"]]
    told = [(event["event"], event["style"]) for event in events if event["event"] in {"contact", "answer_changed"}]
    assert kept.called == called
    assert sorted(told) == [("answer_changed", "angry"), ("contact", called)]
