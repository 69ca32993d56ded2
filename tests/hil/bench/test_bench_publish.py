"""The benchmark of a published session: a program in a process of its own loses nothing."""

from importlib.util import find_spec

import pytest

from highfive.hil.bench.publish import PublishBenchOptions, bench_publish, print_publish
from highfive.hil.runtime.console import progress_bars


@pytest.mark.slow(25)
def test_nothing_is_lost_and_events_have_their_pose(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bars() as bar:
        found = bench_publish(PublishBenchOptions(pairs=1), bar)
    assert found["sent"]["HighFive-Avatar"] == found["sent"]["HighFive-Person"] > 100
    assert found["sent"]["HighFive-Events"] == 3  # raised, met, released
    assert set(found["lost"].values()) == {0} and found["label_errors"] == 0 and found["event_to_pose_ms"] == 0.0
    assert found["vmc"]["frames"] + found["vmc"]["left_out"] == found["sent"]["HighFive-Avatar"]
    assert (found["foxglove"] is None) == (find_spec("foxglove") is None)
    print_publish(found)
    assert "HighFive-Avatar         0 lost of" in capsys.readouterr().out
