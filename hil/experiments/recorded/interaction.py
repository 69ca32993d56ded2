"""How palms came to meet in a study's trials, and whether speeds went together: from the recordings, trial by trial."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from highfive.hil.experiments.analysis.contact_timing import contact_timing
from highfive.hil.experiments.analysis.synchrony import AgainstPseudoPairs, against_pseudo_pairs, lag_profile
from highfive.hil.experiments.protocol import Mode
from highfive.hil.experiments.recorded.trial_motions import TrialMotion, on_motion, trial_motions
from highfive.hil.experiments.trial_row import Key, TrialRow
from highfive.hil.recording.exports.even_times import even_times
from highfive.hil.recording.exports.trial_arrays import TrialArrays
from highfive.hil.runtime.console import Advance
from highfive.hil.sim.avatar import avatar_skeleton, right_palm
from highfive.model.errors import HighFiveError
from highfive.model.evaluation.metrics import speeds
from highfive.model.geometry.rotations import Array

ACTS = (Mode.INTERACTIVE.value, Mode.NO_CONTINGENCY.value)
"""Conditions in which the person raises her hand."""
TIMING: Mapping[str, str] = {
    "person_onset_s": "Begin of the person's reach after the cue, s.",
    "avatar_onset_s": "Begin of the avatar's reach after the cue, s.",
    "person_to_contact_s": "From the begin of the person's reach to the contact, s.",
    "avatar_to_contact_s": "From the begin of the avatar's reach to the contact, s.",
    "person_waiting_s": "For which the person was at the place of the contact already, and still, s.",
    "avatar_waiting_s": "For which the avatar was at the place of the contact already, and still, s.",
    "asynchrony_s": "The person's arrival at the place less the avatar's, s; below 0, she was there first.",
    "closing_speed": "At which the palms came nearer just before the contact, m/s.",
    "miss_m": "Least distance of the palms' points, m.",
    "person_peak_at": "When the person was fastest, as a share of her reach.",
    "person_peaks": "Peaks of the person's speed; one in a smooth reach.",
}
"""Figures of a contact."""
SYNCHRONY: Mapping[str, str] = {
    "synchrony": "Largest mean correlation of both palms' speeds in windows of 0.5 s.",
    "lag_s": "At which it is; above 0, the avatar is behind, s.",
    "pseudo_synchrony": "Its mean over pseudo-pairs: other trials of the same condition, style and cell.",
    "share_below": "Of the pseudo-pairs, lower than the pair: 0.5 is chance.",
}
"""Figures of a pair."""


@dataclass(frozen=True)
class Interaction:
    """Of a study's trials in which somebody acted.

    Attributes:
        figures: trial -> :data:`TIMING` and :data:`SYNCHRONY`, None of what is not known.
        missing: trial -> why there is none of its contact though it was recorded.
    """

    figures: Mapping[Key, Mapping[str, float | None]]
    missing: Mapping[Key, str]


@dataclass(frozen=True)
class _Palms:
    """Both palms (T, 3), m, at one rate; and the cue, s after the first row; None where it is not known."""

    row: TrialRow
    person: Array
    avatar: Array
    rate_hz: float
    cue: float | None


def interaction(study: Path, rows: Sequence[TrialRow], advance: Advance | None = None) -> Interaction:
    """The figures of those rows in which the person acts and of which there is motion; ``advance`` hears of each."""
    figures: dict[Key, dict[str, float | None]] = {}
    missing: dict[Key, str] = {}
    moved = list[_Palms]()
    acted = [row for row in rows if row.condition in ACTS]
    for place, trial in enumerate(trial_motions(study, acted)):
        row = trial.row
        if advance is not None:
            advance(done=place + 1 + len(rows) - len(acted))
        key = row.row_key
        if trial.motion is None:
            if trial.missing:
                missing[key] = trial.missing
            continue
        try:
            palms, found = _trial(trial, trial.motion.load())
        except HighFiveError as error:
            missing[key] = str(error)
            continue
        moved.append(palms)
        figures[key] = {**dict.fromkeys((*TIMING, *SYNCHRONY)), **found}
        if not found:
            missing[key] = "the palms did not meet, or before their third frame"
    for palms, pair in zip(moved, _pairs(moved), strict=True):
        if pair is not None:
            figures[palms.row.row_key] |= {
                "synchrony": pair.pair.height, "lag_s": pair.pair.lag,
                "pseudo_synchrony": pair.pseudo, "share_below": pair.share_below,
            }  # fmt: skip
    return Interaction(figures, missing)


def _trial(trial: TrialMotion, arrays: TrialArrays) -> tuple[_Palms, dict[str, float | None]]:
    """Both tracks, and the figures of the contact; none where palms did not meet."""
    even = even_times(arrays.times, f"trial {trial.row.trial}")
    person = even.between(arrays.points["palm"])
    avatar = even.between(right_palm(avatar_skeleton(), arrays.positions, arrays.orientations)[0])
    cue = on_motion(arrays.span, trial.row.cue_ns)
    cue = None if cue is None else cue - float(arrays.times[0])
    palms = _Palms(trial.row, person, avatar, even.rate_hz, cue)
    judged = arrays.span.contact
    met = judged.get("met_time")
    if judged.get("met") is not True or not isinstance(met, float | int):
        return palms, {}
    contact = float(met) + 1e-9 * arrays.span.start_ns - float(arrays.times[0])
    if not 3.0 <= contact * even.rate_hz <= len(person) - 1.0:
        return palms, {}
    frame = round(contact * even.rate_hz)
    where = judged.get("where")
    place = np.array(where, dtype=float) if _is_point(where) else 0.5 * (person[frame] + avatar[frame])
    found = contact_timing(person, avatar, even.rate_hz, contact, place)
    return palms, {
        "person_onset_s": None if cue is None else found.person.onset - cue,
        "avatar_onset_s": None if cue is None else found.avatar.onset - cue,
        "person_to_contact_s": found.person.time_to_contact,
        "avatar_to_contact_s": found.avatar.time_to_contact,
        "person_waiting_s": found.person.waiting,
        "avatar_waiting_s": found.avatar.waiting,
        "asynchrony_s": found.asynchrony,
        "closing_speed": found.closing_speed,
        "miss_m": found.miss,
        "person_peak_at": found.person.peak_at,
        "person_peaks": float(found.person.peaks),
    }


def _pairs(moved: Sequence[_Palms]) -> list[AgainstPseudoPairs | None]:
    """Each beside its pseudo-pairs, from the cue, or the first row, on; None where there are none, or too few rows."""
    found: list[AgainstPseudoPairs | None] = [None] * len(moved)
    tracks = [(_speed(palms.person, palms), _speed(palms.avatar, palms)) for palms in moved]
    kinds: dict[tuple[object, ...], list[int]] = {}
    for place, palms in enumerate(moved):
        with suppress(HighFiveError):  # it is too short, or one of the two does not move
            lag_profile(*tracks[place], palms.rate_hz)
            kinds.setdefault((palms.rate_hz, *_alike(palms.row)), []).append(place)
    for kind, places in kinds.items():
        firsts, seconds = ([tracks[place][one] for place in places] for one in (0, 1))
        pairs = against_pseudo_pairs(firsts, seconds, [kind] * len(places), moved[places[0]].rate_hz)
        for place, pair in zip(places, pairs, strict=True):
            found[place] = pair
    return found


def _alike(row: TrialRow) -> tuple[object, ...]:
    return row.condition, row.style, tuple(sorted(row.weights.items())), row.cell


def _speed(track: Array, palms: _Palms) -> Array:
    first = 0 if palms.cue is None else max(0, round(palms.cue * palms.rate_hz))
    return speeds(track, palms.rate_hz)[first:]


def _is_point(where: object) -> bool:
    return isinstance(where, list) and len(where) == 3 and all(isinstance(value, float | int) for value in where)
