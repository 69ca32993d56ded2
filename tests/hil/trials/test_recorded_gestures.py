"""Real people who give no high five, before the avatar: from dance and from a laboratory's arm movements."""

from dataclasses import replace
from pathlib import Path

import pytest

from highfive.hil.session.session import Session
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.false_starts import gesture_outcome
from highfive.hil.trials.partners import recorded_partner
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model


@pytest.mark.data
@pytest.mark.slow(20)
@pytest.mark.parametrize(
    ("file", "human", "met_before"),
    [("85_12", None, True), ("85_02", None, False), ("markers_analogs", "Daphnee", True)],
)
def test_who_gives_no_high_five_is_not_met(recordings: Path, file: str, human: str | None, met_before: bool) -> None:
    """A reach may begin, and is given up before the palm is led a quarter of the way; undoubted, two are met."""
    partner = recorded_partner(recordings / "markers" / f"{file}.c3d", human, None, "neutral")
    model, scene = load_model(DEFAULT_MODEL), build_scene()
    led = []
    for one in (model, replace(model, intent=None)):
        session = Session(one, {"neutral": 1.0}, partner.marker_set, scene, correct=False)
        led.append(gesture_outcome(session, partner, 0.0, file).led)
    assert led[0] < 0.25
    assert (led[1] == 1.0) == met_before
