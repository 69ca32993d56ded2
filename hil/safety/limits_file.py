"""The limits' file: read, checked against what no file may say, and only ever lowered at the command line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from highfive.hil.safety.contact_force import contact_speed
from highfive.hil.safety.limits import (
    Ceilings,
    Contact,
    Face,
    Joint,
    Limits,
    LimitsError,
    Motion,
    Offset,
    Posture,
    Section,
    Servo,
    Span,
    Stale,
    Timing,
)
from highfive.model.toml_file import is_list, is_table, read_toml

FILE = Path(__file__).with_name("limits.toml")
"""The limits that come with the project."""


PEER = 1e-9  # relative: two ways to write the same number


SECTIONS: dict[str, type[Any]] = {
    "servo": Servo,
    "posture": Posture,
    "contact": Contact,
    "face": Face,
    "stale": Stale,
    "motion": Motion,
    "feed_forward": Offset,
    "timing": Timing,
}


def load_limits(path: Path = FILE, ceilings: Ceilings | None = None) -> Limits:
    """Reads a limits file of an arm with such ``ceilings``; None for the default arm.

    Raises:
        LimitsError: it cannot be read, lacks or adds an entry, or says what no file may say.
    """
    data = read_toml(path, "limits", LimitsError)
    try:
        return _checked(_parsed(data, ceilings or Ceilings()))
    except LimitsError as error:
        raise LimitsError(f"limits {path}: {error}; nothing moves until the file is put right") from None


def load_safer(path: Path, than: Limits) -> Limits:
    """Reads a limits file for one session: the arm's own limits, or safer ones.

    Args:
        path: the whole file, as :data:`FILE`.
        than: the arm's own limits.

    Raises:
        LimitsError: as :func:`load_limits`, or a limit in it is less safe than the arm's own, or it retracts elsewhere.
    """
    limits = load_limits(path, than.ceilings)
    pairs = [(f"joint.{name}", own, new) for name, own, new in zip(than.names, than.joints, limits.joints, strict=True)]
    pairs += [(name, getattr(than, name), getattr(limits, name)) for name in SECTIONS]
    try:
        for where, own, new in pairs:
            for entry in _spans(type(own)):
                _lowered_entry(own, f"{where}.{entry}", entry, getattr(new, entry))
        if limits.path != than.path:
            raise LimitsError("retract.path cannot be changed at the command line")
    except LimitsError as error:
        raise LimitsError(f"limits {path}: {error}; nothing moves") from None
    return limits


def lowered(limits: Limits, changes: Mapping[str, float]) -> Limits:
    """The limits with some of them made safer.

    Args:
        limits: as loaded.
        changes: by names such as ``contact.speed``, ``joint.elbow.speed``, or ``joint.speed`` for every joint.

    Raises:
        LimitsError: there is no such limit, or it would be less safe than it is.
    """
    for name, value in changes.items():
        section, _, rest = name.partition(".")
        joint, _, entry = rest.rpartition(".")
        if section == "joint" and (joint in limits.names or not joint):
            joints = tuple(
                _lowered_entry(one, name, entry, value) if joint in ("", which) else one
                for which, one in zip(limits.names, limits.joints, strict=True)
            )
            limits = replace(limits, joints=joints)
        elif section in SECTIONS:
            limits = replace(limits, **{section: _lowered_entry(getattr(limits, section), name, rest, value)})
        else:
            raise LimitsError(f"there is no limit {name!r}; they are named as in {FILE.name}, such as contact.speed")
    return _checked(limits)


def parse_changes(texts: Sequence[str]) -> dict[str, float]:
    """What ``lowered`` takes, from words such as ``contact.speed=0.5``.

    Raises:
        LimitsError: a word is not a name, an equals sign and a number.
    """
    changes: dict[str, float] = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            changes[name.strip()] = float(value)
        except ValueError:
            raise LimitsError(f"{text!r} lowers no limit; write it as contact.speed=0.5") from None
    return changes


def _lowered_entry(section: Section, name: str, entry: str, value: float) -> Section:
    spans = _spans(type(section))
    if entry not in spans:
        raise LimitsError(f"there is no limit {name!r}; its section has {', '.join(spans)}")
    span, now = spans[entry], getattr(section, entry)
    _number(value, name, span)
    if span.safer == 0 and value != now:
        raise LimitsError(f"{name} is {now:g} {span.unit} and cannot be changed at the command line")
    if span.safer * (value - now) < 0.0:
        way = "lowered" if span.safer < 0 else "raised"
        raise LimitsError(f"{name} is {now:g} {span.unit} and can only be {way} at the command line, not {value:g}")
    return replace(section, **{entry: float(value)})


def _parsed(data: dict[str, Any], ceilings: Ceilings) -> Limits:
    names = ceilings.names
    _same_names(data, ("joint", *SECTIONS, "retract"), "the file")
    joint, retract = _table(data["joint"], "joint"), _table(data["retract"], "retract")
    if set(joint) - set(names) and set(names) - set(joint):
        raise LimitsError(f"they are of another arm: [joint] has {', '.join(joint)}; this arm has {', '.join(names)}")
    _same_names(joint, names, "[joint]")
    _same_names(retract, ("path",), "[retract]")
    path = retract["path"]
    if not is_list(path) or not path or any(not is_list(p) or len(p) != len(names) for p in path):
        raise LimitsError(f"retract.path has to be one or more poses of {len(names)} angles")
    anywhere = Span("rad", -math.pi, math.pi, 0)
    return Limits(
        joints=tuple(_section(Joint, joint[name], f"joint.{name}") for name in names),
        path=tuple(tuple(_number(angle, "retract.path", anywhere) for angle in pose) for pose in path),
        ceilings=ceilings,
        **{name: _section(kind, data[name], name) for name, kind in SECTIONS.items()},
    )


def _section(kind: type[Section], data: Any, where: str) -> Section:
    spans = _spans(kind)
    _same_names(_table(data, where), tuple(spans), f"[{where}]")
    return kind(**{name: _number(data[name], f"{where}.{name}", span) for name, span in spans.items()})


def _spans(kind: type) -> dict[str, Span]:
    return {f.name: f.metadata["span"] for f in fields(kind)}


def _table(data: Any, where: str) -> Mapping[str, Any]:
    if not is_table(data):
        raise LimitsError(f"{where} has to be a table, got {data!r}")
    return data


def _same_names(data: Mapping[str, Any], names: Sequence[str], where: str) -> None:
    for name in names:
        if name not in data:
            raise LimitsError(f"{where} lacks {name!r}")
    for name in data:
        if name not in names:
            raise LimitsError(f"{where} has {name!r}, which is no limit; it may have {', '.join(names)}")


def _number(value: Any, name: str, span: Span) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise LimitsError(f"{name} has to be a number ({span.unit}), got {value!r}")
    if not span.least <= value <= span.most:
        raise LimitsError(f"{name} is {value:g} {span.unit}; it may be {span.least:g} to {span.most:g}")
    return float(value)


def _checked(limits: Limits) -> Limits:
    """The same limits, if they go together."""
    own = limits.ceilings
    for number, (name, joint) in enumerate(zip(own.names, limits.joints, strict=True)):
        (least, most), stall = own.mechanical[number], own.stall_currents[number]
        if not least - PEER <= joint.lowest < joint.highest <= most + PEER:
            raise LimitsError(
                f"joint.{name} goes from {joint.lowest:g} to {joint.highest:g} rad; "
                f"it has to rise, within {least:.3f} to {most:.3f}"
            )
        if joint.current > stall:
            raise LimitsError(f"joint.{name}.current is {joint.current:g} A; its servo stalls at {stall:g}")
        if joint.contact_current > joint.current:
            raise LimitsError(
                f"joint.{name}.contact_current is {joint.contact_current:g} A, above that of free motion "
                f"({joint.current:g}); lower it, too"
            )
        if joint.braking > joint.acceleration:
            raise LimitsError(
                f"joint.{name}.braking is {joint.braking:g} rad/s², above its acceleration ({joint.acceleration:g}); "
                "lower it, too"
            )
        for pose in limits.path:
            if not joint.lowest <= pose[number] <= joint.highest:
                raise LimitsError(
                    f"retract.path goes through {name} = {pose[number]:g} rad, "
                    f"outside its limits of {joint.lowest:g} to {joint.highest:g}"
                )
    for name, zone in (("contact", limits.contact), ("face", limits.face)):
        fastest = contact_speed(zone.force, zone.body_mass, zone.robot_mass, zone.stiffness)
        if zone.speed > fastest:
            raise LimitsError(
                f"{name}.speed is {zone.speed:g} m/s; {zone.force:g} N allow {fastest:.3f}: lower the speed, too"
            )
    if limits.servo.voltage_low >= limits.servo.voltage_high:
        raise LimitsError("servo.voltage_low has to be below servo.voltage_high")
    if limits.stale.hold_s >= limits.stale.retract_s:
        raise LimitsError("stale.hold_s has to be below stale.retract_s")
    steps = limits.timing.watchdog_s / 0.02
    if abs(steps - round(steps)) > 1e-6:
        raise LimitsError(f"timing.watchdog_s is {limits.timing.watchdog_s:g} s; servos count it in steps of 0.02")
    return limits
