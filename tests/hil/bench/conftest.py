"""A recorded high five for the benchmarks of the arm, and who is met under faults."""

import pytest
from recorded_trials import record_trial
from trial_results import simulated_result

from highfive.hil.arm.contact_outcome import ReferenceTrajectory
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.replay_goals import RecordedHighFives
from highfive.hil.recording.session_reader import read_session
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import Partner, simulated_partners
from highfive.hil.trials.summary import SessionSettings


@pytest.fixture(scope="session")
def reference(tmp_path_factory: pytest.TempPathFactory) -> ReferenceTrajectory:
    path = tmp_path_factory.mktemp("recorded") / "session.mcap"
    with SessionRecorder(path, SessionSettings(seed=5, model="none", trials=1)) as recorder:
        record_trial(recorder, simulated_result(build_scene(), 0, "neutral", "B2"))
    return RecordedHighFives(read_session(path))[0]


@pytest.fixture(scope="session")
def partner() -> Partner:
    return simulated_partners(1, ["happy"], ["B2"], 3)[0]
