"""The webcam's bench: clips of other people than those on which figures are measured, and when a live contact was."""

import numpy as np
import pytest

from highfive.hil.bench.webcam import PRACTICE, WebcamBenchOptions, _placed, play, played
from highfive.hil.bench.webcam_recorded import CHOICE, RecordedClip, load_clips
from highfive.hil.trials.key_frames import contact_tick

OPTIONS = WebcamBenchOptions()


@pytest.fixture(scope="module")
def choice() -> dict[tuple[str, str], RecordedClip]:
    return {(clip.emotion, clip.cell): clip for clip in load_clips(CHOICE)}


def test_settings_are_chosen_on_other_high_fives(choice: dict[tuple[str, str], RecordedClip]) -> None:
    measured = {(clip.emotion, clip.cell): clip for clip in load_clips()}
    assert len(measured) == 36 and len(choice) == 18
    for key, clip in choice.items():
        assert clip.palm.shape != measured[key].palm.shape or np.abs(clip.palm - measured[key].palm).max() > 0.02


@pytest.mark.slow
def test_a_quick_hand_that_is_then_held_is_met_where_it_is(choice: dict[tuple[str, str], RecordedClip]) -> None:
    placement, marker_set = _placed(choice[PRACTICE], OPTIONS)
    felt = play(choice["angry", "C3"], OPTIONS, placement, marker_set)
    assert felt.touched and felt.across < 0.03
    assert 0.0 < felt.time_error < OPTIONS.hold_s + 0.1


@pytest.mark.slow
def test_a_live_contact_is_when_the_palms_were_together(choice: dict[tuple[str, str], RecordedClip]) -> None:
    """The first tick is for a time after the first frame, which does not put the contact off."""
    placement, marker_set = _placed(choice[PRACTICE], OPTIONS)
    result, shown_s, _ = played(choice["neutral", "A2"], OPTIONS, placement, marker_set)
    at = contact_tick(result)
    assert np.linalg.norm(result.palm[at] - result.person_palm[at]) < 0.04
    assert result.contact.met_time_ns == round(1e9 * result.times[at]) and result.contact_time == result.times[at]
    assert len(shown_s) == len(result.times)
