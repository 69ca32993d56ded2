"""Who raises a hand: the same people for a seed, cells and emotions in turn, real people before the avatar."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from highfive.hil.datasets.training_data import track_hand
from highfive.hil.trials.partners import Partner, recorded_partner, simulated_partners
from highfive.mocap_bridge.files.c3d import write_c3d
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.model.errors import HighFiveError

HIGH_FIVE = "high_five/cmu_20_21_11_high_five.c3d"


@pytest.fixture(scope="module")
def partners() -> list[Partner]:
    return simulated_partners(3, ("angry",), ("A2", "C2"), 8)


def test_cells_and_emotions_go_round_and_every_repetition_differs(partners: list[Partner]) -> None:
    assert [p.emotion for p in partners] == ["angry"] * 3
    assert {p.cell for p in partners[:2]} == {"A2", "C2"} and partners[2].cell == partners[0].cell
    first, again = partners[0].palm, partners[2].palm
    assert first is not None and again is not None
    count = min(len(first), len(again))
    assert np.abs(first[:count] - again[:count]).max() > 5e-3
    assert all(p.simulated and "simulated" in p.title for p in partners)


def test_a_seed_gives_the_same_person_whoever_else_comes(partners: list[Partner]) -> None:
    (alone,) = simulated_partners(1, ("angry",), ("A2", "C2"), 8)
    np.testing.assert_array_equal(alone.recording.points, partners[0].recording.points)
    np.testing.assert_array_equal(alone.recording.valid, partners[0].recording.valid)


def test_simulated_palms_met_and_the_tracked_one_is_near_the_true_one(partners: list[Partner]) -> None:
    for partner in partners:
        assert partner.palm is not None and partner.other_palm is not None
        apart = np.linalg.norm(partner.palm - partner.other_palm, axis=-1)
        assert apart[partner.contact_frame] < 2e-3
        tracked = track_hand(partner.recording, partner.marker_set)[1]
        assert np.linalg.norm(tracked - partner.palm, axis=-1)[partner.contact_frame] < 6e-3


def test_in_another_emotion_only_the_answer_changes(partners: list[Partner]) -> None:
    other = partners[0].in_emotion("sad")
    assert other.emotion == "sad" and other.recording is partners[0].recording


def test_who_is_lost_from_view_is_not_seen_from_then_on(partners: list[Partner]) -> None:
    whole, gone = partners[0], partners[0].lost(0.3)
    last = whole.contact_frame - 36  # at 120 Hz
    np.testing.assert_array_equal(gone.recording.points[:last], whole.recording.points[:last])
    assert whole.recording.valid[last:].any() and not gone.recording.valid[last:].any()
    assert not gone.recording.unlabelled_valid[last:].any() and gone.palm is whole.palm
    with pytest.raises(HighFiveError, match="not known when palms met"):
        replace(whole, contact_frame=-1).lost(0.3)


@pytest.mark.data
@pytest.mark.parametrize(("human", "real_other"), [("A", "B"), ("B", "A")])
def test_a_real_person_stands_before_the_avatar(recordings: Path, human: str, real_other: str) -> None:
    partner = recorded_partner(recordings / HIGH_FIVE, human, None, "neutral")
    assert partner.recording.rate_hz == pytest.approx(120.0) and not partner.simulated
    hand, palm, _ = track_hand(partner.recording, partner.marker_set)
    assert partner.palm is None and partner.other_palm is not None
    k = partner.contact_frame
    apart = np.linalg.norm(palm - partner.other_palm, axis=-1)
    assert apart[k] == apart.min() and 0 < k < len(palm) - 1
    # In front of the avatar, at the height of a raised hand, in reach of an arm; the body further away than the hand.
    assert 0.2 < palm[k, 0] < 0.8 and abs(palm[k, 1]) < 0.6 and 1.0 < palm[k, 2] < 2.0
    assert partner.recording.points[k][partner.recording.valid[k]][:, 0].mean() > palm[k, 0]
    assert np.all(hand[k, :, 2] > 0.9)
    assert partner.notes


def test_the_only_person_of_a_file_is_not_her_own_partner(partners: list[Partner], tmp_path: Path) -> None:
    alone = partners[0].recording
    path = tmp_path / "alone.c3d"
    write_c3d(path, replace(alone, names=tuple(f"human:{name}" for name in alone.names)))
    found, named = (recorded_partner(path, human, None, "neutral") for human in (None, "human"))
    assert found.other_palm is None
    assert found.notes == named.notes
    np.testing.assert_array_equal(found.recording.points, named.recording.points)


def test_several_people_in_a_file_and_none_requested_is_one_line(tmp_path: Path) -> None:
    names = [f"{who}:{name}" for who in ("Ann", "Ben") for name in load_marker_set("paper").names]
    points = np.random.default_rng(0).uniform(0.5, 1.5, (1, len(names), 3)).repeat(30, axis=0)
    path = tmp_path / "two.c3d"
    write_c3d(path, make_recording(120.0, names, points, np.ones((30, len(names)), dtype=bool)))
    for human, said in ((None, "Ann, Ben"), ("Eve", "Eve.*Ann, Ben")):
        with pytest.raises(HighFiveError, match=said) as error:
            recorded_partner(path, human, None, "neutral")
        assert "\n" not in str(error.value)
