"""What one trial came to: how near, how fast and how smoothly the palms met."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from highfive.hil.session.reach import Phase
from highfive.hil.session.session import RATE_HZ, Tick, tick_times
from highfive.hil.sim.avatar import Pose
from highfive.hil.sim.contact_check import common_normal, contact_report
from highfive.hil.sim.playout import PlayState
from highfive.hil.trials.not_met import why_not_met
from highfive.hil.trials.partners import Partner
from highfive.hil.trials.trial_result import TrialResult
from highfive.model.geometry.rotations import Array
from highfive.model.online.reaction import current_forecast


def judged(number: int, partner: Partner, ticks: list[Tick], states: list[PlayState], tick_ms: Array) -> TrialResult:
    """The figures of a trial, from its ``ticks``, what was played in each and how long each took, (T,) ms."""
    contact = contact_report(states)
    person_palm = np.array([state.person_palm.position for state in states])
    palm = np.array([state.palm.position for state in states])
    generated_palm = np.array([tick.generated_palm.position for tick in ticks])
    times = tick_times(ticks)
    truth = None if partner.palm is None else TrueMotion(partner.palm, RATE_HZ)
    touched = [i for i, tick in enumerate(ticks) if tick.target.phase is Phase.TOUCH]
    known = partner.contact_frame >= 0
    met = next((i for i, state in enumerate(states) if state.time_ns == contact.met_time_ns), None)
    contact_time = np.nan if met is None else float(times[met])
    nearest = next(i for i, state in enumerate(states) if state.time_ns == contact.nearest_time_ns)
    touch_error, touch_speed = _felt(states, met, truth)
    out_of_reach = any(ticks[i].out_of_reach for i in touched)
    # A live partner's first tick is some time after her first frame: the result counts from the tick on.
    contact = replace(
        contact,
        met_time_ns=None if met is None else round(1e9 * contact_time),
        nearest_time_ns=round(1e9 * float(times[nearest])),
    )
    hinges, generated = _hinge_track([t.pose for t in ticks]), _hinge_track([t.generated for t in ticks])
    fading = np.array([tick.target.phase is Phase.APPROACH for tick in ticks])
    return TrialResult(
        number=number,
        title=partner.title,
        emotion=partner.emotion,
        style=partner.emotion,
        cell=partner.cell,
        simulated=partner.simulated,
        notes=partner.notes,
        contact=contact,
        error=contact.distance,
        uncorrected_error=_nearest(generated_palm, person_palm),
        true_error=np.nan
        if truth is None
        else float(np.linalg.norm(palm[nearest] - truth.at(states[nearest].time_ns))),
        touch_error=touch_error,
        touch_speed=touch_speed,
        palm_angle=contact.palm_angle,
        out_of_reach=out_of_reach,
        why_not_met=why_not_met(ticks, times, contact, out_of_reach),
        contact_time=contact_time,
        time_error=contact_time - partner.contact_frame / RATE_HZ if known else np.nan,
        other_error=np.nan if partner.other_palm is None else _nearest(partner.other_palm, person_palm),
        speed_change=_speed_change(hinges, times, fading),
        uncorrected_speed_change=_speed_change(generated, times, np.ones_like(fading)),
        markers_seen=_seen(ticks),
        times=times,
        people=tuple(tick.person for tick in ticks),
        poses=tuple(state.pose for state in states),
        generated=tuple(tick.generated for tick in ticks),
        person_palm=person_palm,
        palm=palm,
        generated_palm=generated_palm,
        other_palm=partner.other_palm,
        weight=np.array([tick.target.weight for tick in ticks]),
        expected=np.array([tick.response.time_to_contact for tick in ticks]),
        markers=tuple(tick.markers for tick in ticks),
        forecasts=tuple(current_forecast(tick.response) for tick in ticks),
        tick_ms=tick_ms,
    )


class TrueMotion:
    """Where a simulated palm really was, at any time: a cubic spline through its samples."""

    def __init__(self, palm: Array, rate_hz: float) -> None:
        """Through positions (T, 3), m, from time 0 on."""
        self._spline = CubicSpline(np.arange(len(palm)) / rate_hz, palm)
        self._end = (len(palm) - 1) / rate_hz

    def at(self, time_ns: int) -> Array:
        """(3,) m; before the first and after the last sample, that sample."""
        return self._spline(min(max(1e-9 * time_ns, 0.0), self._end))

    def distance(self, place: Array, time_ns: int) -> float:
        """m, of a place (3,) from there."""
        return float(np.linalg.norm(place - self.at(time_ns)))


def _felt(states: Sequence[PlayState], met: int | None, truth: TrueMotion | None) -> tuple[float, float]:
    """What the person would feel at first touch, in the state ``met``: distance, m, of the played palm from the true
    one, and closing speed, m/s; NaN where they did not touch, or nobody knows the true palm."""
    if met is None or truth is None:
        return np.nan, np.nan
    state, before = states[met], states[max(met - 1, 0)].time_ns
    # As the played palm's own: over the last tick.
    seconds = 1e-9 * (state.time_ns - before)
    velocity = (truth.at(state.time_ns) - truth.at(before)) / seconds if seconds > 0.0 else np.zeros(3)
    closing = (state.palm.velocity - velocity) @ common_normal(state.palm, state.person_palm)
    return truth.distance(state.palm.position, state.time_ns), float(closing)


def _seen(ticks: Sequence[Tick]) -> float:
    seen = np.array([tick.markers.seen for tick in ticks])
    return float(seen.mean()) if seen.size else np.nan


def _hinge_track(poses: list[Pose]) -> Array:
    return np.array([pose.hinges for pose in poses])


def _nearest(a: Array, b: Array) -> float:
    count = min(len(a), len(b))
    return float(np.linalg.norm(a[:count] - b[:count], axis=-1).min())


def _speed_change(hinges: Array, times: Array, where: NDArray[np.bool_]) -> float:
    """Largest change of any hinge's speed between ticks, rad/s, over the ticks ``where`` it counts."""
    speeds = np.diff(hinges, axis=0) / np.diff(times)[:, None, None]
    change = np.abs(np.diff(speeds, axis=0)).max(axis=(1, 2))
    chosen = change[where[2:]]
    return float(chosen.max()) if chosen.size else 0.0
