"""``calibrate event`` on a recording in which one tap after the other is seen by three streams with known delays."""

from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_trials import head_of, ticks_of
from trial_results import some_results

from highfive.calibration.latency_file import load_latencies
from highfive.hil.commands.calibrate_event import EventCalibration, calibrate_event
from highfive.hil.commands.session_outputs import known_of
from highfive.hil.commands.simulate_options import SimulateOptions
from highfive.hil.drivers.bus.cycle_ring import Cycle, Mode
from highfive.hil.drivers.values import JointHealth, JointState
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.stream_samples import StreamSamples
from highfive.hil.trials.summary import SessionSettings
from highfive.model.errors import HighFiveError

TAPS = np.array([1.0, 2.03, 3.11, 4.02, 5.2, 6.07, 7.13, 8.04])
"""s of the session."""
BEGAN_NS = 5_000_000_000_000
PERSON_S, EEG_S, AHEAD_NS = 0.012, 0.031, 40_000_000


def samples(name: str, values: list[list[Any]], times: np.ndarray) -> StreamSamples:
    text = isinstance(values[0][0], str)
    labels = ("marker",) if text else ("Fz", "trigger")
    times_ns = [BEGAN_NS + round(1e9 * t) for t in times]
    return StreamSamples(name, labels, text, values, [t - 7.0 for t in times], times_ns, times_ns[-1], True)


def height(since: np.ndarray) -> float:
    """m, of what taps, ``since`` (E,) s after each event: it comes down in 0.2 s, is stopped, and goes up again."""
    down = np.where((since > -0.2) & (since < 0.0), 0.1 * (1.0 - ((since + 0.2) / 0.2) ** 2), np.inf)
    up = np.where((since >= 0.0) & (since < 0.5), 0.1 / (1.0 + np.exp(-(since - 0.3) / 0.04)), np.inf)
    return min(0.1, down.min(), up.min())


def tapped(number: int) -> Cycle:
    """A cycle of the bus, at 100 Hz, of an arm whose shoulder brings its plate down onto the person's hand."""
    time_ns, joints = BEGAN_NS + number * 10_000_000, np.zeros(6)
    state = JointState(
        time_ns, joints, joints, joints, joints.astype(int), np.ones(6, bool), np.zeros(6, bool), joints
    )  # fmt: skip
    shoulder = np.array([0.0, 3.0 * height(1e-9 * (time_ns - BEGAN_NS) - TAPS), 0.0, 0.0, 0.0, 0.0])
    state = replace(state, positions=shoulder)
    return Cycle(number, Mode.DRIVING, time_ns, time_ns, 1_900_000, None, state, JointHealth(0, joints, joints))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A hand at 120 Hz that is late by 12 ms, an amplifier at 500 Hz by 31 ms; an arm and a force plate in time."""
    result, path = some_results()[0], tmp_path_factory.mktemp("taps") / "session.mcap"
    rng, one = np.random.default_rng(3), next(ticks_of(result))
    assert one.frame is not None
    eeg = np.arange(0.0, 9.5, 0.002)
    pulses = ((eeg[:, None] - EEG_S - TAPS >= 0.0) & (eeg[:, None] - EEG_S - TAPS < 0.05)).any(axis=1)
    with SessionRecorder(path, SessionSettings(seed=1, model="m", trials=1)) as recorder:
        recorder.begin_trial(head_of(result))
        for i in count():
            captured = i / 120.0
            if captured > 9.5:
                break
            points = one.frame.positions + rng.normal(0.0, 2e-5, one.frame.positions.shape)
            points[:, 2] += height(captured - PERSON_S - TAPS)
            own_ns = round(1e9 * captured)
            frame = replace(one.frame, number=i, positions=points, source_time_ns=own_ns)
            at_ns = BEGAN_NS + own_ns + AHEAD_NS  # the pose is for the time at which it is shown
            recorder.record_tick(replace(one, frame=frame, time_ns=own_ns + AHEAD_NS, at_ns=at_ns))
        rows = [[float(v), 40.0 * p + v] for v, p in zip(rng.normal(size=len(eeg)), pulses, strict=True)]
        # The recording's clock begins with its first tick, which is for 40 ms after the first frame.
        recorder.record_stream(samples("EEG", rows, eeg))
        recorder.record_arm((), [tapped(number) for number in range(12, 950)])
        recorder.record_stream(samples("plate", [["tap"] if k % 2 else ["TAP"] for k in range(8)], TAPS))
        recorder.end_trial(result)
    return path


@pytest.mark.parametrize(
    ("stream", "reference", "late_ms", "off_ms"),
    [
        ("person", "lsl/plate", 1e3 * PERSON_S, 3.0),
        pytest.param("lsl/EEG", "lsl/plate", 1e3 * EEG_S, 1.1, marks=pytest.mark.slow),
        pytest.param("person", "arm", 1e3 * PERSON_S, 3.0, marks=pytest.mark.slow),
        pytest.param("lsl/EEG", "arm", 1e3 * EEG_S, 3.0, marks=pytest.mark.slow),
        ("lsl/EEG", "person", 1e3 * (EEG_S - PERSON_S), 3.0),
    ],
)
@pytest.mark.slow
def test_a_stream_is_found_as_late_as_it_is(
    stream: str, reference: str, late_ms: float, off_ms: float, recorded: Path, tmp_path: Path
) -> None:
    out = tmp_path / "latencies.toml"
    found = calibrate_event(EventCalibration(recorded, stream, reference, out=out))
    assert found["events"] == len(TAPS) and abs(found["latency_ms"] - late_ms) < off_ms
    assert 0.0 <= found["bound_ms"] < 5.0
    kept = load_latencies(out)[stream]
    assert (kept.latency_ms, kept.reference, kept.source) == (found["latency_ms"], reference, "session.mcap")
    known = known_of(SimulateOptions(latencies=out))[stream]
    assert known.latency_ns == round(1e6 * found["latency_ms"])
    with pytest.raises(HighFiveError, match=r"has .* already"):
        calibrate_event(EventCalibration(recorded, stream, reference, out=out))
    calibrate_event(EventCalibration(recorded, stream, reference, out=out, overwrite=True))


@pytest.mark.slow
def test_each_latency_is_kept_beside_the_others_and_nonsense_is_one_line(recorded: Path, tmp_path: Path) -> None:
    options = EventCalibration(recorded, "person", "lsl/plate", out=tmp_path / "latencies.toml")
    calibrate_event(options)
    calibrate_event(replace(options, stream="lsl/EEG", channel="trigger"))
    assert load_latencies(options.out).keys() == {"person", "lsl/EEG"}
    other = replace(options, out=tmp_path / "other.toml")
    for wrong, said in (
        ({"stream": "lsl/none"}, r"no stream lsl/none; it has person, arm, lsl/EEG, lsl/plate"),
        ({"stream": "lsl/EEG", "reference": "headset"}, "headset: the recording has no stream headset"),
        ({"stream": "lsl/EEG", "channel": "Cz"}, "no channel 'Cz'; there are Fz, trigger"),
        ({"stream": "lsl/plate", "reference": "lsl/EEG"}, "31.* ms earlier than lsl/EEG; exchange"),
        ({"reference_channel": "tap"}, "4 events are seen by both"),
    ):
        with pytest.raises(HighFiveError, match=said) as error:
            calibrate_event(replace(other, **wrong))
        assert "\n" not in str(error.value)
    assert not other.out.exists()
