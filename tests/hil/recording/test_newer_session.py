"""Who opens an older recording is told of a newer one that a kill left beside it."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from recorded_trials import record_trial
from trial_results import some_results

from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.recording import read_recording
from highfive.hil.recording.session_reader import read_session
from highfive.hil.trials.summary import SessionSettings
from highfive.model.files import leftovers


@pytest.mark.parametrize("read", [read_session, read_recording, lambda path: read_session(path.parent)])
@pytest.mark.slow
def test_it_says_which_file_opens_the_newer_one_and_nothing_of_an_older_one(
    read: Callable[[Path], object], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path, (first, second, *_) = tmp_path / "session.mcap", some_results()
    with SessionRecorder(path, SessionSettings(seed=1, model="m", trials=1)) as recorder:
        record_trial(recorder, first)
    os.utime(path, (1e9, 1e9))
    killed = SessionRecorder(path, SessionSettings(seed=2, model="m", trials=1))
    record_trial(killed, second)
    (left,) = leftovers(path)
    read(path)
    (told,) = [record.getMessage() for record in caplog.records]
    assert str(left) in told and "older session" in told and "\n" not in told
    caplog.clear()
    newer = read_session(left)
    assert newer.settings["seed"] == 2 and newer[0].contact and not newer.complete
    os.utime(left, (9e8, 9e8))
    read(path)
    assert not caplog.records
    killed.close()
