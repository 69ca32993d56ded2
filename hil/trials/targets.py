"""How a session's figures stand to the project's targets, and why a target is missed; see docs/performance.md."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Row = Mapping[str, Any]

BEFORE_MM = 60.0
"""mm, for the median before correction, which is for the last centimetres. The shipped model keeps it with much room
for people like those it was trained on (14 and 15 at seeds 0 and 7); others, and models of one's own, may not."""
_LISTED = 3
"""Trials that a miss names, the worst first."""
_MACHINE = (
    "This machine's timing while it ran, beside whatever else it did; not the method's. Run it again with nothing "
    "beside it."
)
_UNCORRECTED = "Not judged: the contact correction was off."
_UNKNOWN = "Not judged: it could be measured in no trial; palms that never touch have no such figure."
_NO_TICK = "Not judged: no tick was measured."
_NO_TRIAL = "Not judged: there is no trial of a hand within reach."


@dataclass(frozen=True)
class Target:
    """A figure beside its target.

    Attributes:
        what, target, measured: for people.
        met: None where the figure is missing or the target does not apply.
        why: of a miss: which trials, and what it comes from; of what is not judged, why not; '' where it is met.
    """

    what: str
    target: str
    measured: str
    met: bool | None
    why: str = ""


@dataclass(frozen=True)
class _Limit:
    """A target for one figure of a trial: its key in the rows, its limits, its unit, and why a trial misses it."""

    what: str
    key: str
    median: float | None
    largest: float | None
    unit: str
    reason: Callable[[Row], str]

    def targets(self, rows: Sequence[Row], *, applies: bool) -> list[Target]:
        """One for the median and one for the largest; of a single trial only the one figure there is."""
        known = [row for row in rows if row[self.key] is not None]
        values = sorted(row[self.key] for row in known)
        limits = {name: limit for name, limit in (("median", self.median), ("largest", self.largest)) if limit}
        if len(rows) == 1 and len(limits) > 1:
            limits.pop("largest")
        listed = []
        for name, limit in limits.items():
            value = None if not values else values[-1] if name == "largest" else _median(values)
            met = None if value is None or not applies else value <= limit
            what = self.what if len(rows) == 1 else f"{self.what}, {name}"
            over = [row for row in known if row[self.key] > limit]
            why = self._why(over, len(known), name) if met is False else ""
            if met is None:
                why = _UNCORRECTED if not applies else _UNKNOWN if rows else _NO_TRIAL
            listed.append(Target(what, f"≤ {_with(limit, self.unit, 'g')}", _with(value, self.unit), met, why))
        return listed

    def _why(self, over: Sequence[Row], count: int, name: str) -> str:
        worst = sorted(over, key=lambda row: -row[self.key])[:_LISTED]
        named = "; ".join(f"{trial_name(row)} {_with(row[self.key], self.unit)}, {self.reason(row)}" for row in worst)
        if count == 1:
            return f"{self.reason(over[0])[:1].upper()}{self.reason(over[0])[1:]}."
        share = f"Over it: {len(over)} of {count}" if name == "median" or len(over) > 1 else "Over it: one"
        return f"{share}{', the worst' if len(over) > _LISTED else ''}: {named}."


def targets(summary: Mapping[str, Any]) -> list[Target]:
    """The project's targets beside what was measured, what a person would feel first."""
    corrected, simulated, tick = summary["corrected"], summary["simulated"], summary["tick_ms"]
    far = {entry["trial"] for entry in summary["out_of_reach_trials"]}
    rows = summary["rows"]
    # A simulated person stands where both can reach; a recorded one may not.
    judged = rows if simulated else [row for row in rows if row["trial"] not in far]
    listed = _FELT.targets(rows, applies=corrected) if simulated else []
    listed += _arm_targets(summary["arm"]) if summary["arm"] else []
    listed += _BEFORE.targets(rows, applies=True)
    listed += _TRACKED.targets(judged, applies=corrected)
    listed += _ANGLE.targets(judged, applies=corrected) + _FADE_IN.targets(rows, applies=corrected)
    listed += [
        _time("one tick, half of all", tick["p50"], 1.0),
        _time("one tick, 99 of 100", tick["p99"], 3.0),
    ]
    return listed


def trial_name(row: Row) -> str:
    """``trial 4 (angry, C1)``, as far as it is known."""
    known = ", ".join(row[name] for name in ("style", "cell") if row.get(name))
    if "trial" not in row:
        return known
    return f"trial {row['trial'] + 1}" + (f" ({known})" if known else "")


def _felt(row: Row) -> str:
    """Why the played palm was far from the true one when they touched."""
    tracked = row["true_error_mm"]
    if tracked is not None and tracked > 0.5 * row["true_error_at_touch_mm"]:
        return f"the palm as tracked was itself off, by {tracked:.1f} mm at contact"
    return "they touched beside the palms' middle before the correction was through"


def _reached(row: Row) -> str:
    """Why the palm did not come to the tracked one."""
    if row["out_of_reach"]:
        return "out of the avatar's reach"
    return "the correction fell short of it" if row["met"] else "they did not touch"


_FELT = _Limit("played palm from the true palm at first touch", "true_error_at_touch_mm", 5.0, 15.0, "mm", _felt)
_BEFORE = _Limit(
    "before correction, palm to palm", "uncorrected_error_mm", BEFORE_MM, None, "mm",
    lambda row: "what the model itself makes of this hand",
)  # fmt: skip
_TRACKED = _Limit("after correction, to the palm as tracked", "contact_error_mm", None, 5.0, "mm", _reached)
_ANGLE = _Limit("angle between the palms", "palm_angle_deg", None, 5.0, "°", _reached)
_FADE_IN = _Limit(
    "step in joint speed at fade-in", "speed_change_ratio", None, 1.0, "×",
    lambda row: f"{row['uncorrected_error_mm']:.0f} mm were to be made up for before contact",
)  # fmt: skip


def _arm_targets(arm: Mapping[str, Any]) -> list[Target]:
    able = [row for row in arm["rows"] if row["possible"] and not row["broken_off"]]
    rows = [{**row, "style": row["emotion"], "off_ms": _size(row["time_error_ms"])} for row in able]
    missed = arm["missed_cycles"]
    cycles = Target("servo arm: cycles of the bus missed", "none", str(missed), not missed, _MACHINE if missed else "")
    return [*_PLATE.targets(rows, applies=True), *_LATE.targets(rows, applies=True), cycles]


def _plate(row: Row) -> str:
    if not row["touched"]:
        return "they did not touch"
    if row["limits"]:
        return f"these limits acted: {', '.join(row['limits'])}"
    return "no limit acted: the forecast of place and time was off, or how the joints followed"


_PLATE = _Limit("servo arm: plate to palm as tracked", "error_mm", 5.0, 15.0, "mm", _plate)
_LATE = _Limit("servo arm: off in time", "off_ms", None, 25.0, "ms", _plate)


def _size(value: float | None) -> float | None:
    return None if value is None else abs(value)


def _time(what: str, value: float | None, limit: float) -> Target:
    met = None if value is None else value <= limit
    return Target(what, f"≤ {limit:g} ms", _with(value, "ms"), met, {True: "", False: _MACHINE, None: _NO_TICK}[met])


def _with(value: float | None, unit: str, form: str = ".2f") -> str:
    if value is None:
        return "–"
    return f"{value:{form}}{unit}" if unit == "°" else f"{value:{form}} {unit}"


def _median(values: Sequence[float]) -> float:
    middle = len(values) // 2
    return values[middle] if len(values) % 2 else 0.5 * (values[middle - 1] + values[middle])
