"""A trial: what Ctrl-C leaves of it."""

import signal

import pytest

from highfive.hil.session.opening import open_session
from highfive.hil.session.session import Tick
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import simulated_partners
from highfive.hil.trials.trial import run_trial


def test_a_trial_that_is_interrupted_in_a_tick_keeps_the_whole_of_it() -> None:
    partner = simulated_partners(1, ["happy"], ["B2"], 0, lambda total: lambda: None)[0]
    scene, session = build_scene(), open_session(partner.marker_set, "happy")
    kept, before = [], signal.getsignal(signal.SIGINT)

    def watch(tick: Tick) -> None:
        if len(kept) == 5:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run_trial(
            0, partner, session, KinematicPlayOut(scene), watch=watch,
            keep=lambda begins, tick, state, tick_ms: kept.append(tick),
        )  # fmt: skip
    assert len(kept) == 6 and signal.getsignal(signal.SIGINT) is before
