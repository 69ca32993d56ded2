"""The figures of a session: one JSON object.

Everything in it but ``tick_ms`` follows from the seed: two sessions with one seed give the same object, timings apart.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from highfive.hil.sim.contact_check import UnwantedContact
from highfive.hil.trials.trial_result import TrialResult
from highfive.mocap_bridge.sources.address import is_live

MM, MS = 1e3, 1e3
FAR_OFF_MM = 100.0
"""mm before correction beyond which the model was far from the hand: if palms met, the correction did all of it."""
_FINGERS = ("palm", "thumb", "index", "middle", "ring", "little")


@dataclass(frozen=True)
class SessionSettings:
    """What a session was asked to do.

    Attributes:
        seed: of all random draws.
        model: the model's name, with whatever tells it from others of that name.
        trials: how many were planned.
        style: weights of the emotions; None where each trial is answered in the partner's own emotion.
        corrected: the contact correction was on.
        physics: the pose was played through actuators.
        source: the recording that the person came from, '' for simulated people.
        arm: the servo arm that takes part: ``emulated``, or its port; '' for none.
        arm_name: which one: its name, or its folder; '' for the one that a session has unless it is told otherwise.
        command: the command line that does it again; in report and recording, not among the figures.
    """

    seed: int
    model: str
    trials: int
    style: dict[str, float] | None = None
    corrected: bool = True
    physics: bool = False
    source: str = ""
    arm: str = ""
    arm_name: str = ""
    command: str = ""


@dataclass(frozen=True)
class _Column:
    """One figure of a trial: how to get it in the unit that its name gives."""

    name: str
    value: Callable[[TrialResult], float]
    factor: float = field(default=1.0)

    def of(self, results: Iterable[TrialResult]) -> list[float]:
        return [self.factor * self.value(result) for result in results]


_SPREADS = (
    _Column("contact_error_mm", lambda r: r.error, MM),
    _Column("uncorrected_error_mm", lambda r: r.uncorrected_error, MM),
    _Column("true_error_mm", lambda r: r.true_error, MM),
    _Column("true_error_at_touch_mm", lambda r: r.touch_error, MM),
    _Column("closing_speed_at_touch_m_s", lambda r: r.touch_speed),
    _Column("other_error_mm", lambda r: r.other_error, MM),
    _Column("palm_angle_deg", lambda r: r.palm_angle, math.degrees(1.0)),
    _Column("time_error_ms", lambda r: r.time_error, MS),
    _Column("approach_speed_m_s", lambda r: r.contact.approach_speed),
    _Column("peak_force_n", lambda r: r.contact.peak_force),
    _Column("speed_change_ratio", lambda r: _ratio(r.speed_change, r.uncorrected_speed_change)),
)


def summarise(
    results: Sequence[TrialResult],
    settings: SessionSettings,
    *,
    interrupted: bool = False,
    unrecorded: str = "",
    replayed: dict[str, Any] | None = None,
    arm: dict[str, Any] | None = None,
    streams: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """The JSON object of a session: numbers, strings, lists and objects of them; what is not known is None.

    Spreads have ``median``, ``max`` (what is furthest from 0, sign kept) and ``by_emotion``, which is by the style that
    the avatar answered in. Errors are palm centre to palm centre: ``contact_error_mm`` of what was played, at its
    nearest to the palm as tracked, ``uncorrected_error_mm`` of what the model generated, likewise; ``true_error_mm`` of
    the nearest as played, to the simulated person's true palm; ``true_error_at_touch_mm`` and
    ``closing_speed_at_touch_m_s`` to that palm when they first touch; ``other_error_mm`` of who met that hand
    originally. Of each row, ``emotion`` is the one that was requested: the simulated person's, or the one in which a
    real person is answered; ``style`` is what the avatar answered in; ``person_emotion`` is the simulated person's,
    None of a real one. ``arm`` is :func:`highfive.hil.arm.arm_figures.arm_summary`, None where no servo arm took part.
    ``why_not_met`` says it of a trial without contact; None of one with it.
    Trials out of reach and without contact count in all of them. ``warnings`` are sentences for people.
    ``unrecorded`` says why the recording ends before the session; '' where it does not. ``replayed`` compares with the
    recording that was played again (:meth:`highfive.hil.recording.replay.Replay.summary`); None where none was.
    ``streams`` are those of a session that keeps time, as they stood last: see
    :class:`highfive.hil.session.stream.StreamState`; of pages ``shown`` says what they have shown.
    """
    unwanted = [entry for result in results for entry in _unwanted(result)]
    out_of_reach = [
        {"trial": r.number, "title": r.title, "distance_mm": _number(MM * r.error)} for r in results if r.out_of_reach
    ]
    missed = [r.number for r in results if not r.contact.met]
    spreads = {column.name: _spread(column, results) for column in _SPREADS}
    return {
        "trials": len(results),
        "planned": settings.trials,
        "interrupted": interrupted,
        "simulated": all(r.simulated for r in results) if results else not settings.source,
        "live": bool(settings.source) and is_live(settings.source),
        "seed": settings.seed,
        "model": settings.model,
        "style": settings.style,
        "source": settings.source or None,
        "corrected": settings.corrected,
        "physics": settings.physics,
        "rig": settings.arm or None,
        "unrecorded": unrecorded,
        "replayed": replayed,
        "streams": list(streams),
        "warnings": [*([unrecorded] if unrecorded else []), *_warnings(results, settings.corrected)],
        **spreads,
        "by_cell": _by_cell(results),
        "missed": len(missed),
        "missed_trials": missed,
        "out_of_reach": len(out_of_reach),
        "out_of_reach_trials": out_of_reach,
        "unwanted_contacts": len(unwanted),
        "unwanted": unwanted,
        "rows": [_row(result) for result in results],
        "versions": versions(),
        "arm": arm,
        "tick_ms": _tick(results),
    }


def kind(summary: Mapping[str, Any]) -> str:
    """Whether the person whose hand was met is ``simulated``, ``live`` or ``recorded``."""
    return "simulated" if summary["simulated"] else "live" if summary["live"] else "recorded"


def without_timings(summary: dict[str, Any]) -> dict[str, Any]:
    """What has to be the same for two sessions with one seed: a servo arm goes by the clock."""
    return {name: value for name, value in summary.items() if name not in ("tick_ms", "arm")}


def versions() -> dict[str, str]:
    """Versions of what the figures depend on."""
    found = {"python": platform.python_version()}
    for package in ("high-five", "mujoco", "numpy", "scipy", "jax"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found


def styles_of(results: Iterable[TrialResult]) -> list[str]:
    """The styles that the avatar answered in, in order of appearance; ``'unknown'`` stands for none."""
    return list(dict.fromkeys(style_of(result) for result in results))


def style_of(result: TrialResult) -> str:
    """The style that the avatar answered in, or ``'unknown'``."""
    return result.style or "unknown"


def body_part(shape: str) -> str:
    """What a contact shape belongs to, for people: ``'right_ring_2'`` is of the right hand."""
    owner, _, rest = shape.partition("_")
    if rest.split("_")[0] in _FINGERS:
        return f"{owner} hand" if owner != "person" else "person's hand"
    if owner == "person":
        return "person's " + rest.replace("_", " ")
    joints = {"elbow": "forearm", "shoulder": "upper arm", "hip": "thigh", "knee": "shank"}
    part = {"thoracic": "trunk", "lumbar": "trunk"}.get(owner, shape)
    for joint, segment in joints.items():
        part = part.replace(joint, segment)
    return part.replace("_", " ")


def _warnings(results: Sequence[TrialResult], corrected: bool) -> list[str]:
    known = [result for result in results if math.isfinite(result.uncorrected_error)]
    far = [result for result in known if MM * result.uncorrected_error > FAR_OFF_MM]
    if not corrected or not far:
        return []
    before = [MM * result.uncorrected_error for result in known]
    met = sum(result.contact.met for result in far)
    if len(known) == 1:
        off = f"{before[0]:.0f} mm off at the nearest"
        said, far_from = f"Before correction the avatar's palm was {off}", "the model was far from this hand"
    else:
        said = (
            f"Before correction the avatar's palm was over {FAR_OFF_MM:.0f} mm off at the nearest in {len(far)} of "
            f"{len(known)} trials (median of all {np.median(before):.0f} mm, largest {max(before):.0f})"
        )
        far_from = "there the model was far from the hand"
    if not met:  # each of them says why: the hand may have been hidden
        return [f"{said}, and the palms did not meet{'' if len(known) == 1 else ' there'}."]
    where = "" if met == len(far) else f" in the {met} of them in which the palms met"
    all_of_it = f"the contact correction did all of it{where}. How near the palms came says nothing of the model."
    return [f"{said}: {far_from}; {all_of_it}"]


def _ratio(change: float, largest: float) -> float:
    return change / largest if largest > 0.0 else math.nan


def _number(value: float) -> float | None:
    """A float that JSON can hold, to six digits."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def _extent(values: Iterable[float]) -> dict[str, float | None]:
    known = [v for v in values if math.isfinite(v)]
    if not known:
        return {"median": None, "max": None}
    return {"median": _number(float(np.median(known))), "max": _number(max(known, key=abs))}


def _spread(column: _Column, results: Sequence[TrialResult]) -> dict[str, Any]:
    groups = {e: [r for r in results if style_of(r) == e] for e in styles_of(results)}
    return {
        **_extent(column.of(results)),
        "by_emotion": {emotion: _extent(column.of(group)) for emotion, group in groups.items()},
    }


def _by_cell(results: Sequence[TrialResult]) -> dict[str, dict[str, Any]]:
    cells = sorted({result.cell for result in results if result.cell})
    return {cell: {c.name: _extent(c.of(r for r in results if r.cell == cell)) for c in _SPREADS[:2]} for cell in cells}


def _unwanted(result: TrialResult) -> list[dict[str, Any]]:
    """Unwanted contacts of a trial, one a pair of body parts: a hand's fingers would otherwise be 16 findings."""
    pairs: dict[tuple[str, str], list[UnwantedContact]] = {}
    for contact in result.contact.unwanted:
        pairs.setdefault((body_part(contact.first), body_part(contact.second)), []).append(contact)
    return [
        {
            "trial": result.number,
            "title": result.title,
            "first": first,
            "second": second,
            "time_s": _number(1e-9 * min(c.first_time_ns for c in contacts)),
            "deepest_mm": _number(MM * max(c.deepest for c in contacts)),
        }
        for (first, second), contacts in pairs.items()
    ]


def _row(result: TrialResult) -> dict[str, Any]:
    return {
        "trial": result.number,
        "title": result.title,
        "emotion": result.emotion or None,
        "style": result.style or None,
        "person_emotion": (result.emotion or None) if result.simulated else None,
        "cell": result.cell or None,
        "simulated": result.simulated,
        "met": result.contact.met,
        "out_of_reach": result.out_of_reach,
        "why_not_met": result.why_not_met or None,
        "contact_time_s": _number(result.contact_time),
        **{column.name: _number(column.of([result])[0]) for column in _SPREADS},
        "gap_mm": _number(MM * result.contact.gap),
        "lateral_mm": _number(MM * result.contact.lateral),
        "fade_in_change_rad_s": _number(result.speed_change),
        "uncorrected_change_rad_s": _number(result.uncorrected_speed_change),
        "markers_seen": _number(result.markers_seen),
        "unwanted_contacts": len(_unwanted(result)),
        "notes": list(result.notes),
    }


def _tick(results: Sequence[TrialResult]) -> dict[str, Any]:
    if not results:
        return {"p50": None, "p99": None, "max": None, "ticks": 0}
    ticks = np.concatenate([result.tick_ms for result in results])
    return {
        "p50": _number(float(np.percentile(ticks, 50))),
        "p99": _number(float(np.percentile(ticks, 99))),
        "max": _number(float(ticks.max())),
        "ticks": int(ticks.size),
    }
