"""What is known of a trial once it is over: one row, in the columns that data in long format need."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from highfive.model.errors import HighFiveError
from highfive.model.toml_file import check_keys, typed

Key = tuple[str, int, int]
"""Participant, session, ask: of a row in a study."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What happened in a trial. Times of the session's clock, ns; None where there is none.

    Attributes:
        weights: emotion -> share, that were shown.
        answer, key: given; empty where none was.
        rt_s, rt_contact_s: from the opening of the question, which is right after the motion, and from contact, to the
            answer.
        certainty: 0 to 1.
        ratings: name -> value.
        peak_speed: of the person's palm, m/s: the avatar's follows it, whatever the style.
        motion_s: from the cue to the motion's end.
        longest_gap_s, stalled_s: the longest time between two of its ticks, more than 1/120 s where the computer, or
            what tracks her, stood still; and all such times together, as far as they are beyond two ticks.
        cue_ns, contact_ns, ended_ns, asked_ns, answer_ns: when they were: the motion ended, the question opened. In a
            replay the contact is that which is shown.
        source_ns, arrival_ns, tick_ns, shown_ns: of the frame in which palms met (or the motion ended): by the source's
            own clock, as it came, as it was answered, as that was shown.
        frame: its number.
        recording: file beside the log that holds its motion; empty where there is none.
        notes: the experimenter's.
        broken_off: why; empty where it was not.
        excluded_why: why it does not count, such as an answer after the limit; empty where it does.
    """

    weights: Mapping[str, float] = field(default_factory=dict)
    answer: str = ""
    key: str = ""
    rt_s: float | None = None
    rt_contact_s: float | None = None
    certainty: float | None = None
    ratings: Mapping[str, float] = field(default_factory=dict)
    peak_speed: float | None = None
    motion_s: float | None = None
    longest_gap_s: float | None = None
    stalled_s: float | None = None
    cue_ns: int | None = None
    contact_ns: int | None = None
    ended_ns: int | None = None
    asked_ns: int | None = None
    answer_ns: int | None = None
    source_ns: int | None = None
    arrival_ns: int | None = None
    tick_ns: int | None = None
    shown_ns: int | None = None
    frame: int | None = None
    recording: str = ""
    notes: str = ""
    broken_off: str = ""
    excluded_why: str = ""


@dataclass(frozen=True, kw_only=True)
class TrialRow(Outcome):
    """A row of the log.

    Attributes:
        ask: the how manieth trial of the session it was, from 1: a trial asked again is another row.
        participant, session: who, and which of her sessions.
        block, trial, condition: of the plan; the condition is the block's mode.
        style, expected, cell, clip, source_trial: of the plan; ``expected`` is the right answer.
        viewpoint, own_arm: of a replay.
        software, seed, calibration: version, seed of the plan, hash of the calibration in use.
        language: of the instructions and the page.
        simulated: no person answered.
        begun_utc_ns, utc_ns: time of day as it began and was over, ns since 1970.
    """

    ask: int
    participant: str
    session: int
    block: str
    trial: str
    condition: str
    style: str
    expected: str
    cell: str
    clip: int
    source_trial: str
    viewpoint: str
    own_arm: str
    software: str
    seed: int
    calibration: str
    simulated: bool
    language: str = ""
    begun_utc_ns: int
    utc_ns: int

    @property
    def row_key(self) -> Key:
        """Which row of a study's it is."""
        return self.participant, self.session, self.ask


COLUMNS = [one.name for one in fields(TrialRow)]
SINCE = {"motion_s": None, "longest_gap_s": None, "stalled_s": None, "language": ""}
"""Columns that earlier logs lack, and what they read as there."""
_KINDS: dict[str, type] = {"str": str, "int": int, "float": float, "bool": bool}


def row_of(values: Mapping[str, Any], where: str) -> TrialRow:
    """A row of its values by column.

    Raises:
        HighFiveError: one is missing, or of another kind; the message begins with ``where``.
    """
    check_keys(values, where, set(COLUMNS) - set(SINCE), set(SINCE))
    values = {**SINCE, **values}
    return TrialRow(**{one.name: _value(values, f"{where}: ", one.name, str(one.type)) for one in fields(TrialRow)})


def _value(values: Mapping[str, Any], where: str, name: str, kind: str) -> Any:
    value = values[name]
    if kind.endswith(" | None"):
        return None if value is None else typed(values, where, name, _KINDS[kind.removesuffix(" | None")])
    if kind in _KINDS:
        return typed(values, where, name, _KINDS[kind])
    if not isinstance(value, Mapping):
        raise HighFiveError(f"{where}{name} is {value!r}, expected a table of numbers")
    return {key: typed(value, f"{where}{name}.", key, float) for key in value}
