"""What of a stated covariance lasts: it has no part in the filter, and comes on top of what the filter says."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.bench.webcam_recorded import load_clips
from highfive.mocap_bridge.markers.recognise import find_marker_set
from highfive.mocap_bridge.sources.camera_person import CameraPerson
from highfive.mocap_bridge.sources.camera_settings import MARKERS
from highfive.mocap_bridge.tracking.filter_settings import WEBCAM
from highfive.mocap_bridge.tracking.tracker import Tracker, passing


@pytest.mark.parametrize("most", [0.005, 0.05, 1.0])
def test_what_passes_and_what_lasts_are_all_that_is_stated(most: float) -> None:
    roots = np.random.default_rng(0).normal(0.0, 0.06, (40, 3, 3))
    stated = roots @ roots.swapaxes(1, 2)
    fresh, rest = passing(stated, most)
    np.testing.assert_allclose(fresh + (rest if len(rest) else 0.0), stated, atol=1e-12)
    assert np.linalg.eigvalsh(fresh).max() <= most**2 * (1 + 1e-9)
    np.testing.assert_allclose(
        np.linalg.eigvalsh(fresh), np.minimum(np.linalg.eigvalsh(stated), most**2), atol=1e-12
    )  # nothing is taken from a direction in which it is little
    assert not len(passing(np.zeros((0, 3, 3)), most)[0])


def test_a_hand_is_where_it_was_and_as_unsure_as_the_camera_says() -> None:
    """The same frames with their errors cut to what passes give the same motion; only what is stated differs."""
    marker_set = find_marker_set(MARKERS)
    trackers, person = [Tracker(marker_set, 15.0, WEBCAM) for _ in range(2)], CameraPerson()
    for found in load_clips()[0].landmarks:
        frame = person.take(found)
        assert frame.covariance is not None
        fresh, rest = passing(frame.covariance, WEBCAM.passing)
        whole, cut = (
            tracker.update(one)
            for tracker, one in zip(trackers, (frame, replace(frame, covariance=fresh)), strict=True)
        )
        np.testing.assert_allclose(whole.positions, cut.positions, atol=1e-9)
        columns = marker_set.match(frame.names)
        expected = cut.covariances + np.where((columns >= 0)[:, None, None], rest[columns], 0.0)
        np.testing.assert_allclose(whole.covariances, expected, atol=1e-9)
