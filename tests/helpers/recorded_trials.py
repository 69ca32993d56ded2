"""Trial results as a session would record them, tick by tick."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from trial_results import simulated_result

from highfive.hil.arm.arm_trial import ArmTrial
from highfive.hil.recording.recorded_tick import RecordedTick
from highfive.hil.recording.recorder import SessionRecorder, TrialHead
from highfive.hil.sim.people.capture import PERSON_SET
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.summary import SessionSettings
from highfive.hil.trials.trial_result import TrialResult
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set


def head_of(result: TrialResult) -> TrialHead:
    nothing = make_recording(120.0, (), np.zeros((0, 0, 3)), np.zeros((0, 0), dtype=bool))
    partner = Partner(
        result.title, result.emotion, result.cell, result.simulated, nothing, load_marker_set(PERSON_SET), -1, None,
        None, result.notes,
    )  # fmt: skip
    return TrialHead(result.number, partner, result.style, {result.emotion: 1.0})


def ticks_of(result: TrialResult, from_ns: int = 0) -> Iterator[RecordedTick]:
    """At the session's time ``from_ns`` and on."""
    for i, second in enumerate(result.times):
        now, markers = round(1e9 * float(second)), result.markers[i]
        frame = MarkerFrame(markers.names, markers.positions, markers.seen, i, now, now, np.zeros((0, 3)))
        yield RecordedTick(
            frame, now, from_ns + now, markers, result.people[i], result.generated[i], result.poses[i], result.poses[i],
            result.forecasts[i], "approach", float(result.weight[i]), float(result.expected[i]),
            float(result.tick_ms[i]),
        )  # fmt: skip


def record_two(path: Path, emotion: str) -> Path:
    """A recording of two high fives in which the palms met."""
    scene = build_scene()
    with SessionRecorder(path, SessionSettings(seed=5, model="none", trials=2)) as recorder:
        for number in range(2):
            record_trial(recorder, simulated_result(scene, number, emotion, "B2"))
    return path


def record_trial(recorder: SessionRecorder, result: TrialResult, arm: ArmTrial | None = None, from_ns: int = 0) -> None:
    recorder.begin_trial(head_of(result))
    for tick in ticks_of(result, from_ns):
        recorder.record_tick(tick)
    if arm is not None:
        recorder.record_arm(arm.ticks, arm.cycles)
    recorder.end_trial(result)
