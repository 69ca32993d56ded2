"""How sure the tracker says it is of a hidden marker, against where a real one was."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from highfive.mocap_bridge.markers.one_person import read_person
from highfive.mocap_bridge.tracking.tracked_recording import track_recording


@pytest.mark.data
@pytest.mark.slow(30)
@pytest.mark.parametrize("hidden", [12, 36, 60])
def test_hidden_markers_are_within_two_standard_deviations(recordings: Path, hidden: int) -> None:
    """The hand of a real person, hidden for 0.1, 0.3 and 0.5 s at a time; the set is not fitted to her."""
    one = read_person(recordings / "markers" / "85_12.c3d", "Male", None)
    part = slice(600, 2400)
    whole = replace(one.recording, points=one.recording.points[part], valid=one.recording.valid[part])
    valid = whole.valid.copy()
    trio = [whole.names.index(name) for name in ("RWRA", "RWRB", "RFIN")]
    for start in range(60, len(valid) - 90, 90):
        valid[start : start + hidden, trio] = False
    tracked = track_recording(replace(whole, valid=valid), one.marker_set)
    true, _ = one.marker_set.arrange(whole.names, whole.points, whole.valid)
    put_in = tracked.hidden & tracked.usable
    error = np.linalg.norm(tracked.filled - true, axis=-1)[put_in]
    assert np.isfinite(tracked.filled_sd[put_in]).all() and np.isnan(tracked.filled_sd[~put_in]).all()
    assert 0.8 < (error < 2.0 * tracked.filled_sd[put_in]).mean() < 0.995
