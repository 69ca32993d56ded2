"""What comes of other programs' streams before the first high five: kept up to a bound, and counted beyond."""

from itertools import islice
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded_trials import head_of, ticks_of
from trial_results import some_results

from highfive.hil.recording.background import BackgroundRecorder
from highfive.hil.recording.early_samples import EARLY, EarlySamples
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.recording import read_recording
from highfive.hil.recording.stream_samples import StreamSamples
from highfive.hil.trials.summary import SessionSettings


def chunk(name: str, first: int, count: int, *, begins: bool = False) -> StreamSamples:
    numbers = range(first, first + count)
    rows = [[float(i), 0.5] for i in numbers]
    return StreamSamples(
        name, ("Fz", "Cz"), False, rows, [float(i) for i in numbers], [100 + i for i in numbers], 200, begins
    )


@given(st.lists(st.tuples(st.sampled_from("AB"), st.integers(1, 9)), min_size=1, max_size=40), st.integers(1, 60))
def test_the_newest_are_kept_in_order_and_none_is_unaccounted_for(sent: list[tuple[str, int]], most: int) -> None:
    early, counts = EarlySamples(most), {"A": 0, "B": 0}
    for name, count in sent:
        early.add(chunk(name, counts[name], count, begins=counts[name] == 0))
        counts[name] += count
    taken = list(early.taken())
    assert list(early.taken()) == []
    for name, count in counts.items():
        mine = [samples for samples in taken if samples.name == name]
        assert [stamp for samples in mine for stamp in samples.stamps] == list(range(early.dropped[name], count))
        assert [samples.begins for samples in mine] == [True, *[False] * (len(mine) - 1)][: len(mine)]
    assert taken[-1].name == sent[-1][0]
    held = sum(len(row) for samples in taken for row in samples.values)
    assert held <= most or len(taken) == 1


@pytest.mark.parametrize("seconds", [40, 20])
def test_a_recording_says_what_it_lacks_and_names_the_channels_all_the_same(
    seconds: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """An EEG of 256 channels at 128 Hz: half a minute of it is kept while a person is waited for."""
    result, path = some_results()[1], tmp_path / "session.mcap"
    recorder = BackgroundRecorder(SessionRecorder(path, SessionSettings(seed=1, model="m", trials=1)), paced=False)
    with recorder:
        for i in range(seconds):
            rows, stamps = [[0.5] * 256] * 128, [i + k / 128 for k in range(128)]
            labels = tuple(f"E{k}" for k in range(256))
            recorder.record_stream(StreamSamples("EEG", labels, False, rows, stamps, [1] * 128, 2, i == 0))
        recorder.begin_trial(head_of(result))
        for tick in islice(ticks_of(result), 3):
            recorder.record_tick(tick)
    recording = read_recording(path)
    found = recording.channels["/lsl/EEG"]
    told = [m.data["detail"] for m in recording.channels.get("/event", ()) if m.data["event"] == "lsl_dropped"]
    lost = max(0, seconds - EARLY // (256 * 128)) * 128
    assert [m.data["stamp"] for m in found] == [k / 128 for k in range(lost, seconds * 128)]
    assert found[0].data["labels"] == found[-1].data["labels"] == [f"E{k}" for k in range(256)]
    wanted = f"EEG: the first {lost} samples, of before the first high five, are not kept"
    assert told == ([wanted] if lost else [])
    assert (f"{lost} samples of before the first high five are not in the recording" in caplog.text) == bool(lost)
