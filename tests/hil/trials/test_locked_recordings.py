"""The locked set as a data folder: the same people as everywhere else, all of them held out."""

from pathlib import Path

import numpy as np
import pytest

from highfive.hil.datasets.training_data import load_trials, track_hand
from highfive.hil.trials.locked_recordings import write_locked
from highfive.hil.trials.locked_set import locked_pair, locked_trials
from highfive.mocap_bridge.files.c3d import read_c3d


@pytest.mark.slow
def test_its_people_are_tracked_as_in_a_session_and_all_are_held_out(tmp_path: Path) -> None:
    chosen = [locked_trials()[n] for n in (0, 60, 99)]
    pairs = [pair for pair in map(locked_pair, chosen) if pair is not None]
    assert len(pairs) >= 2
    write_locked(tmp_path, trials=chosen)
    solved = load_trials(tmp_path)
    assert len(solved) == len(pairs) and all(one.trial.test for one in solved)
    for one, (partner, pair) in zip(solved, pairs, strict=True):
        assert one.trial.emotion == partner.emotion and one.trial.cell == partner.cell
        hand, palm, _ = track_hand(partner.recording, partner.marker_set)
        scale = np.linalg.norm(one.trial.hand_points) / np.linalg.norm(hand)  # the scene grows with the avatar
        np.testing.assert_allclose(one.trial.hand_points, scale * hand, atol=2e-3)
        np.testing.assert_allclose(one.trial.person_palm, scale * palm, atol=2e-3)
        assert abs(one.trial.contact_frame - pair.contact_frame) < 30
    recorded = read_c3d(tmp_path / "locked_001.c3d").person("human")
    np.testing.assert_allclose(recorded.points, pairs[0][0].recording.points, atol=1e-4)
