"""Why palms did not meet: the reason that is said is the one that was in the way."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.session.opening import open_session
from highfive.hil.session.session import PERIOD_NS, Session, TickInput
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.distractors import Drawn, distractor_partner
from highfive.hil.trials.partners import Partner, simulated_person
from highfive.hil.trials.trial import as_captured, run_trial
from highfive.mocap_bridge.files.recording import Recording


@pytest.fixture(scope="module")
def why() -> Callable[..., str]:
    """The reason that a trial with the partner has."""
    scene, sessions = build_scene(), dict[str, Session]()

    def of(partner: Partner, every: int = 1) -> str:
        session = sessions.setdefault("one", open_session(partner.marker_set, "happy"))
        session.set_style({"happy": 1.0})
        inputs = _thinned(partner, every) if every > 1 else None
        result = run_trial(0, partner, session, KinematicPlayOut(scene), inputs)
        assert result.contact.met == (not result.why_not_met)
        return result.why_not_met

    return of


def _thinned(partner: Partner, every: int) -> Iterator[TickInput]:
    """A tick each 1/120 s, a frame in one of so many."""
    for number, tick in enumerate(as_captured(partner.frames())):
        frame = tick.frame if number % every == 0 else None
        yield replace(tick, frame=frame, time_ns=tick.time_ns if number else tick.time_ns - PERIOD_NS // 2)


def _changed(partner: Partner, change: Callable[[Recording], Recording]) -> Partner:
    return replace(partner, recording=change(partner.recording), palm=None)


def _moved(by: tuple[float, float, float]) -> Callable[[Recording], Recording]:
    return lambda r: replace(r, points=np.where(r.valid[..., None], r.points + np.array(by), 0.0))


def _without(r: Recording, first: int, names: Callable[[str], bool]) -> Recording:
    gone = np.array([names(name) for name in r.names])
    valid = r.valid.copy()
    valid[first:, gone] = False
    return replace(r, valid=valid, points=np.where(valid[..., None], r.points, 0.0))


def test_palms_that_meet_have_no_reason(why: Callable[..., str]) -> None:
    assert why(simulated_person("happy", "B2", 0)) == ""


@pytest.mark.slow
def test_a_person_out_of_reach(why: Callable[..., str]) -> None:
    assert "reach" in why(_changed(simulated_person("happy", "B2", 0), _moved((0.45, 0.0, 0.0))))


@pytest.mark.slow
def test_a_hand_that_is_never_seen_hidden_or_not_raised(why: Callable[..., str]) -> None:
    partner = simulated_person("happy", "B2", 0)
    never = _changed(partner, lambda r: _without(r, 0, lambda name: True))
    assert why(never) == "the person's hand was not seen"
    hidden = _changed(partner, lambda r: _without(r, partner.contact_frame - 60, lambda name: True))
    assert why(hidden).startswith("the person's hand was hidden for ")
    low = _changed(partner, _moved((0.0, 0.0, -0.7)))  # of 0.78 m a rising hand was met
    assert why(low).startswith("the person's hand was not raised: it came up to ")


@pytest.mark.slow
def test_too_few_pictures(why: Callable[..., str]) -> None:
    partner = simulated_person("angry", "A1", 0)
    never = _changed(partner, lambda r: _without(r, 0, lambda name: True))
    for one in (partner, never):  # that she was not seen in them says less
        said = why(one, every=120)
        assert said.startswith("only 1.") and "pictures" in said


@pytest.mark.slow
def test_a_gesture_that_is_no_high_five(why: Callable[..., str]) -> None:
    partner, _ = distractor_partner(Drawn("scratch", "happy", (3, 1)))
    said = why(partner)
    assert said.startswith("the model took it for no high five") and "reach begins at 0." in said
