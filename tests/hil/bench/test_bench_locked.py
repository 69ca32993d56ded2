"""The locked set: unlike everybody that anything was chosen on, the same every time, and judged by the true palm."""

import numpy as np
import pytest

from highfive.hil.bench.locked import bench_locked
from highfive.hil.session.session import RATE_HZ, Session
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.people.capture import Defects
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.locked_set import SUBJECTS, locked_partner, locked_trials
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model


def test_the_set_covers_every_person_in_every_emotion_and_all_cells():
    trials = locked_trials()
    assert len(trials) >= 60 and len(set(trials)) == len(trials)
    assert {(t.subject, t.emotion) for t in trials} == {(s, e) for s in range(len(SUBJECTS)) for e in EMOTIONS}
    assert len({t.cell for t in trials}) == 9


def test_people_are_built_as_they_say_and_captured_worse_than_usual():
    own = avatar_skeleton()
    for subject in SUBJECTS:
        body, size = subject.body, subject.stature / 1.75
        arm = [np.linalg.norm(body.offsets[body.index(f"right_{n}")]) for n in ("elbow", "wrist")]
        usual = [np.linalg.norm(own.offsets[own.index(f"right_{n}")]) for n in ("elbow", "wrist")]
        assert np.array(arm) / usual == pytest.approx(size * subject.arms)
        assert body.offsets[body.index("right_hip")] == pytest.approx(size * own.offsets[own.index("right_hip")])
        assert subject.defects != Defects() and subject.slip > 0.0
    assert min(s.stature for s in SUBJECTS) < 0.92 * 1.75 and max(s.stature for s in SUBJECTS) > 1.08 * 1.75


def test_one_person_is_the_same_every_time_and_wears_markers_elsewhere_than_the_set_says():
    trial = locked_trials()[0]
    one, again = locked_partner(trial), locked_partner(trial)
    assert one is not None and again is not None and one.draws >= 1
    assert np.array_equal(one.recording.points, again.recording.points) and np.array_equal(one.palm, again.palm)


@pytest.mark.slow
def test_figures_are_of_the_true_palm_in_the_tick_of_first_touch():
    chosen = [locked_trials()[0], locked_trials()[-1]]
    result = bench_locked(DEFAULT_MODEL, lambda label, total: lambda note="", done=None: None, chosen)
    scene, errors, speeds, added = build_scene(), [], [], []
    model, playout = load_model(DEFAULT_MODEL), KinematicPlayOut(scene)
    for trial in chosen:
        partner = locked_partner(trial)
        session = Session(model, {trial.emotion: 1.0}, partner.marker_set, scene)
        previous, touched, work, times = None, False, [], []
        for number, frame in enumerate(C3DSource(partner.recording, RATE_HZ)):
            tick = session.step(frame)
            state = (playout.step if number else playout.reset)(tick.pose, tick.person, frame.source_time_ns)
            apart = partner.palm[number] - state.palm.position
            touching = any({t.first, t.second} == {"right_palm", "person_palm"} for t in state.touches)
            work.append(tick.pose.hinges - tick.generated.hinges)
            times.append(1e-9 * frame.source_time_ns)
            if not touched and (
                touching
                or (
                    abs((tick.person.palm.position - state.palm.position) @ state.palm.normal) < 0.002
                    and np.linalg.norm(tick.person.palm.position - state.palm.position) < 0.04
                )
            ):
                errors.append(1e3 * np.linalg.norm(apart))
                speeds.append((previous - apart) @ state.palm.normal * RATE_HZ)
                touched = True
            previous = apart
        added.append(max(np.abs((b - a) / dt).max() for a, b, dt in zip(work, work[1:], np.diff(times), strict=False)))
    rows = result["rows"]
    assert [row["true_error_mm"] for row in rows] == pytest.approx(errors, abs=2e-3)
    assert [row["closing_speed_m_s"] for row in rows] == pytest.approx(speeds, abs=0.01)
    assert [row["correction_rad_s"] for row in rows] == pytest.approx(added, abs=2e-3)
    assert result["trials"] == 2 and result["missed"] == 0 and result["pairs_drawn"] >= 2
    assert result["true_error_mm"]["max"] == max(row["true_error_mm"] for row in rows)
    assert set(result["by_subject"]) == {SUBJECTS[0].name, SUBJECTS[-1].name}
