"""The figures of a servo arm: of one high five, and of a session.

A long session keeps these of each high five, some 50 kB, and not every tick and cycle, which are some MB.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highfive.hil.arm.arm_trial import MISSED, MS, ArmTrial, percentiles
from highfive.hil.arm.contact_outcome import ContactOutcome
from highfive.hil.arm.planner import Retarget
from highfive.hil.safety.limits import Limits
from highfive.hil.safety.rules import Rule
from highfive.hil.safety.states import HALTED
from highfive.hil.session.session import RATE_HZ
from highfive.model.geometry.rotations import Array

Short = NDArray[np.float32]


@dataclass(frozen=True)
class ArmFigures:
    """Of one high five of T ticks and C cycles.

    Attributes:
        number: of the trial, as the recording has it.
        met: how plate and palm met.
        broken_off: the arm was stopped before.
        stopped: why it was stopped; '' where it was not.
        following: (T, J) rad, of the joints beside where they were planned.
        currents: (C, J) A.
        periods_ms: (C - 1,) from cycle to cycle.
        took_ms: (C,) of a cycle, until all answers were there.
        retarget_ms, step_ms: (T,) of planning, and with the envelope.
        speeds: m/s, as :meth:`ArmTrial.separation_speeds` has them.
        unanswered: cycles in which a servo did not answer.
        acted: how many ticks each rule of the envelope acted in.
    """

    number: int
    met: ContactOutcome
    broken_off: bool
    stopped: str
    following: Short
    currents: Short
    periods_ms: Array
    took_ms: Array
    retarget_ms: Array
    step_ms: Array
    speeds: dict[str, float]
    unanswered: int
    acted: Counter[str]

    @property
    def hand_lost(self) -> bool:
        """The arm held, or went back, for the person was not seen any more; and palms did not meet."""
        return not self.met.touched and bool({Rule.STALE_HOLD.value, Rule.STALE_RETRACT.value} & set(self.acted))


def arm_figures(number: int, trial: ArmTrial, retarget: Retarget, limits: Limits, stopped: str = "") -> ArmFigures:
    """Of the high five of a number, by the arm of ``retarget`` within ``limits``; ``stopped`` is why it was stopped,
    where more is known than its ticks say.
    """
    return ArmFigures(
        number,
        trial.met,
        trial.broken_off,
        stopped
        or next((tick.report.reason for tick in (*trial.ticks, *trial.back.ticks) if tick.report.state in HALTED), ""),
        trial.following_error(retarget.settings.lag).astype(np.float32),
        trial.currents.astype(np.float32),
        trial.periods_ms,
        1e-6 * np.array([cycle.took_ns for cycle in trial.cycles], dtype=float),
        np.array([tick.retarget_ms for tick in trial.ticks]),
        np.array([tick.step_ms for tick in trial.ticks]),
        trial.separation_speeds(retarget.arm, limits),
        sum(not bool(cycle.state.answered.all()) for cycle in trial.cycles),
        trial.acted,
    )


WHOLE = 40
"""High fives of which every tick and cycle is kept, for figures and film."""


@dataclass(frozen=True)
class ArmResults:
    """What the arm did in a session.

    Attributes:
        figures: of every high five, in order.
        whole: the first :data:`WHOLE` of them, by number.
    """

    figures: list[ArmFigures] = field(default_factory=list)
    whole: dict[int, ArmTrial] = field(default_factory=dict)

    def add(self, number: int, trial: ArmTrial, retarget: Retarget, limits: Limits, stopped: str = "") -> None:
        """The next high five; see :func:`arm_figures`."""
        self.figures.append(arm_figures(number, trial, retarget, limits, stopped))
        if len(self.whole) < WHOLE:
            self.whole[number] = trial


def arm_summary(trials: Sequence[ArmFigures], retarget: Retarget, stricter: Sequence[str] = ()) -> dict[str, Any]:
    """The figures of the arm in a session: numbers, strings, lists and objects of them; what is not known is None.

    ``error_mm`` is plate to palm where they touched, or at the nearest; ``time_error_ms`` later than the session's own
    contact. Trials that are not ``possible`` (out of reach, or known of too late) are listed and not in them;
    those that were ``broken_off`` by a stop are counted and not in them. In those of ``hand_lost`` the arm held, or
    went back, for the person was not seen. ``lag_ms`` is by how much ``retarget`` planned ahead of time, ``lag_from``
    where that is from; ``stricter`` is what the operator made so, such as ``contact.speed=0.5``. ``closing_speed`` and
    ``face_speed`` are the largest near hand and head, m/s, of what went on the ``wire`` and of the ``body``.
    """
    whole = [trial for trial in trials if not trial.broken_off]
    able = [trial for trial in whole if trial.met.possible]
    touched = [trial for trial in able if trial.met.touched]
    periods, took, planning, step = (
        _joined([getattr(trial, name) for trial in trials])
        for name in ("periods_ms", "took_ms", "retarget_ms", "step_ms")
    )
    following = _joined([np.abs(trial.following).max(axis=1) for trial in trials])
    period, speeds = MS / RATE_HZ, [trial.speeds for trial in trials]
    return {
        "trials": len(trials),
        "error_mm": _extent([MS * trial.met.error for trial in able]),
        "time_error_ms": _extent([MS * abs(trial.met.late) for trial in touched]),
        "max_relative_speed": max((round(trial.met.speed, 3) for trial in trials if trial.met.touched), default=None),
        "missed": len(able) - len(touched),
        "missed_trials": _named(trial for trial in able if not trial.met.touched),
        "hand_lost": _named(trial for trial in whole if trial.hand_lost),
        "unreachable": _named(trial for trial in whole if not trial.met.possible),
        "broken_off": len(trials) - len(whole),
        "lag_ms": round(MS * retarget.settings.lag, 2),
        "lag_from": retarget.lag_from,
        "following_error_mrad": percentiles(MS * following),
        "cycles": len(took),
        "missed_cycles": int((periods > MISSED * period).sum()),
        "period_jitter_ms": percentiles(np.abs(periods - period)),
        "cycle_ms": percentiles(took),
        "retarget_ms": percentiles(planning),
        "step_ms": percentiles(step),
        "closing_speed": {which: _largest(speeds, f"{which}_closing_speed") for which in ("wire", "body")},
        "face_speed": {which: _largest(speeds, f"{which}_face_speed") for which in ("wire", "body")},
        "largest_current_A": max((round(float(np.abs(t.currents).max()), 2) for t in trials), default=None),
        "unanswered": sum(trial.unanswered for trial in trials),
        "stricter": list(stricter),
        "rules": dict(sum((trial.acted for trial in trials), Counter())),
        "stopped": next((trial.stopped for trial in trials if trial.stopped), ""),
        "rows": [_row(trial) for trial in trials],
    }


def _named(trials: Iterable[ArmFigures]) -> list[str]:
    """By style and cell, or else by number, from 1 as in the report's table."""
    return [f"{trial.met.emotion} {trial.met.cell}".strip() or f"high five {trial.number + 1}" for trial in trials]


def _row(trial: ArmFigures) -> dict[str, Any]:
    met = trial.met
    return {
        "trial": trial.number,
        "emotion": met.emotion,
        "cell": met.cell,
        "possible": met.possible,
        "touched": met.touched,
        "broken_off": trial.broken_off,
        "error_mm": round(MS * met.error, 2),
        "time_error_ms": round(MS * met.late, 1) if met.touched else None,
        "relative_speed": round(met.speed, 3) if met.touched else None,
        "scale": round(met.relaxation.scale, 3),
        "delay_ms": round(MS * met.relaxation.delay, 1),
        "miss_mm": round(MS * met.relaxation.miss, 1),
        "limits": list(met.relaxation.limit_names),
    }


def _largest(speeds: Sequence[dict[str, float]], name: str) -> float:
    return round(max((found[name] for found in speeds), default=0.0), 3)


def _extent(values: Sequence[float]) -> dict[str, float | None]:
    if not values:
        return {"median": None, "max": None}
    return {"median": round(float(np.median(values)), 2), "max": round(float(np.max(values)), 2)}


def _joined(parts: Sequence[Array]) -> Array:
    return np.concatenate(parts).astype(float) if parts else np.zeros(0)
