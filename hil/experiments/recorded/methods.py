"""A methods paragraph of a study, filled with its plan, its settings and its counts; what only the lab knows is in [].

It says what was done, from protocol, logs and recordings, and claims nothing about what came out.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from highfive.hil.experiments.analysis.adaptive import AdaptiveSettings
from highfive.hil.experiments.analysis.hierarchical import HierarchySettings
from highfive.hil.experiments.analysis.psychometric import PsychometricSettings
from highfive.hil.experiments.balance import PRACTICE
from highfive.hil.experiments.exclusion import ExclusionRules
from highfive.hil.experiments.protocol import Block, Mode, Motion, Protocol
from highfive.hil.experiments.study import session_folder
from highfive.hil.experiments.study_rows import StudyRows
from highfive.hil.recording.session_reader import read_session
from highfive.model.errors import HighFiveError

_MODES = {
    Mode.INTERACTIVE: "the avatar answered the participant",
    Mode.OWN_REPLAY: "the participant watched a replay of her own trials of block {of}",
    Mode.OTHER_REPLAY: "the participant watched the trials of block {of} of the participant before her",
    Mode.NO_CONTINGENCY: "the participant acted while the avatar played a recorded answer of {of} at its own time",
}
_SOURCE = "Taubert, N., Christensen, A., Endres, D., & Giese, M. A. (2013)"


def methods(study: Path, found: StudyRows, level: float, rules: ExclusionRules | None) -> str:
    """Markdown.

    Args:
        study: its folder, whose first recording says with what was recorded.
        found: its trials.
        level: of all intervals.
        rules: the lab's own exclusions.
    """
    about = _recorded_with(study, found)
    shown = bool(about) or not all(row.simulated for row in found.counted or found.rows)
    parts = [
        _participants(found), _apparatus(found.protocol, about) if shown else _nothing_shown(found.protocol),
        _procedure(found.protocol, shown=shown), _answers(found.protocol), _data(found, rules),
        _analysis(found.protocol, level, simulated=found.simulated),
        _software(found),
    ]  # fmt: skip
    heading = "# Methods\n\nMade by `highfive experiment analyse`; what stands in [brackets] is yours to fill in.\n\n"
    warning = "**All participants were simulated. This is no study of people.**\n\n" if found.simulated else ""
    return heading + warning + "\n\n".join(parts) + "\n"


def _participants(found: StudyRows) -> str:
    everybody = {row.participant for row in found.rows}
    counted = {row.participant for row in found.counted}
    sessions = {(row.participant, row.session) for row in found.rows}
    kind = "simulated participant" if found.simulated else "participant"
    took_part = (
        f"**Participants.** {_n(len(everybody), kind)} took part in {_n(len(sessions), 'session')}; {len(counted)} "
        "are in the analysis."
    )
    if found.simulated:
        return f"{took_part} They are programs: nobody was recruited, and no consent was asked for."
    return (
        f"{took_part} [Age, sex, vision, handedness, recruitment, payment.] [The ethics committee of … approved "
        f"the study;] all signed version {found.protocol.consent} of the consent form."
    )


def _nothing_shown(protocol: Protocol) -> str:
    return (
        "**Apparatus.** No avatar was shown and nobody was tracked: simulated participants answered from their "
        f"plans alone. Styles were {_list([style.name for style in protocol.styles])}."
    )


def _apparatus(protocol: Protocol, about: Mapping[str, Any]) -> str:
    motion = (
        "Its motion was generated online by a hierarchical Gaussian process dynamical model, which answered the "
        "participant's hand and brought the avatar's palm to it"
        if protocol.motion is Motion.MODEL
        else f"Its motion was played from recorded clips, {protocol.clips} of each style"
    )
    source = str(about.get("source") or "")
    tracked = f"the participant was tracked by {source} " if source else "the participant was tracked by "
    kind = "model file " if protocol.motion is Motion.MODEL else ""
    model = f" ({kind}{about['model']})" if about.get("model") else ""
    arm = f" A servo arm ({about['arm_name']}) took part." if about.get("arm_name") else ""
    return (
        "**Apparatus.** Participants stood before a life-size avatar of 53 joints in MuJoCo, at 120 Hz. "
        f"{motion}{model}. "
        f"Styles were {_list([style.name for style in protocol.styles])}; "
        f"{tracked}[motion capture system, number of cameras, rate; screen or headset].{arm}"
    )


def _procedure(protocol: Protocol, *, shown: bool) -> str:
    blocks = "; ".join(_block(protocol, block) for block in protocol.blocks)
    parts = (
        f" The {len(protocol.parts)} parts were in the orders of a Williams square between participants."
        if len(protocol.parts) > 1
        else ""
    )
    cells = (
        f" Palms were to meet in {len(protocol.cells)} places, each style in each equally often."
        if protocol.cells
        else ""
    )
    practice = f" {_n(protocol.practice, 'practice trial')} of each style came before." if protocol.practice else ""
    replay = (
        " In replays the recorded poses were rendered again in the same scene and at the same rate, in a new order; "
        f"the viewpoint was {_live(protocol.replay.viewpoint, 'the recorded one')} and the participant's arm "
        f"{_live(protocol.replay.own_arm, 'the recorded one')}."
        if shown
        else " Replays were asked in a new order; nothing was rendered."
    ) + " A replay never came right after its source."
    replay = replay if any(block.of for block in protocol.blocks) else ""
    timing = protocol.timing
    return (
        f"**Procedure.** Blocks were: {blocks}.{parts}{cells}{practice} Each style was shown equally often in a "
        "block, and "
        f"at most {protocol.order.alike} times in a row; orders were drawn for each participant from seed "
        f"{protocol.seed}, "
        f"all orders that keep to this being equally likely.{replay} A cue began each trial {timing.between_s:g} s "
        "after "
        f"the last answer; trials of more than {timing.trial_s:g} s were broken off, answers later than "
        f"{timing.answer_s:g} s do not count. A block in which the run was stopped, or interrupted for more than "
        f"{timing.pause_s / 60:g} min, began again."
    )


def _block(protocol: Protocol, block: Block) -> str:
    filler = " (a filler, not analysed)" if block.filler else ""
    return (
        f"{block.name}, {protocol.trials_of(block)} trials, in which {_MODES[block.mode].format(of=block.of)}{filler}"
    )


def _answers(protocol: Protocol) -> str:
    sliders = [
        f"“{one.text}” ({one.low} to {one.high}" + (f", 1–{one.points})" if one.points else ")")
        for one in protocol.ratings
    ]
    certainty = "how sure they were, and then " if protocol.certainty and sliders else ""
    certainty = certainty or ("how sure they were" if protocol.certainty else "")
    more = f" They then said {certainty}{_list(sliders)}." if sliders or certainty else ""
    return (
        f"**Answers.** After each motion participants chose one of {_list(list(protocol.labels))} by key; which key "
        "meant "
        f"which was drawn for each participant. Reaction times are from the end of the motion.{more}"
    )


def _data(found: StudyRows, rules: ExclusionRules | None) -> str:
    why = Counter(one.why for one in found.excluded)
    listed = "; ".join(f"{reason}, {count}" for reason, count in why.most_common()) or "none"
    own = (
        f" The laboratory's rules were those of {rules.source} (SHA-256 {rules.digest}…)." if rules is not None else ""
    )
    lost = "".join(f" Log of {one.participant}, session {one.session}: {one.why}." for one in found.incomplete)
    return (
        f"**Data.** Of {_n(len(found.rows), 'trial')} {len(found.counted)} are analysed. Not analysed, with the "
        "number of "
        f"trials: {listed}.{own}{lost}"
    )


def _analysis(protocol: Protocol, level: float, *, simulated: bool) -> str:
    h, p = HierarchySettings(), PsychometricSettings()
    if protocol.morph is None:
        text = (
            "Recognition in interaction and replay was compared by a hierarchical model of each participant's "
            "empirical "
            f"logit difference; beforehand the mean effect is N({h.centre:g}, {h.spread:g}²) logit and the standard "
            f"deviation between participants half-normal with scale {h.between:g}"
            + ("" if simulated else f". Rates by the rules of the source study ({_SOURCE}) are reported beside it")
        )
    else:
        kind = "constant levels" if not protocol.morph.adaptive else (
            "levels that were chosen for the least expected entropy of PSE and slope "
            f"({AdaptiveSettings().levels} levels, {protocol.order.easy_share:.0%} pure styles)"
        )  # fmt: skip
        text = (
            f"Morphs from {protocol.morph.start} to {protocol.morph.end} were shown at {kind}. Psychometric functions, "
            "cumulative normals with symmetric lapses, were fitted for each participant on a grid; beforehand PSE is "
            f"N({p.pse:g}, {p.pse_spread:g}²), the width's logarithm N(ln {p.width:g}, {p.width_spread:g}²), and "
            "lapses are "
            f"exponential with mean {p.lapse:g}. Shifts of the PSE were pooled over participants by a hierarchical "
            "model"
        )
    return f"**Analysis.** {text}. Intervals are {100 * level:g} % posterior intervals."


def _software(found: StudyRows) -> str:
    mixed = " (mixed: each trial says its own)" if len(found.software) > 1 else ""
    spoken = sorted({row.language for row in found.rows if row.language})
    language = f" Instructions and page were in {_list(spoken)} (ISO 639-1)." if spoken else ""
    place = {row.calibration for row in found.rows if row.calibration}
    calibration = f" Calibration: {_list(sorted(place))}." if place else ""
    return (
        f"**Software.** High Five {_list(list(found.software))}{mixed}; experiment {found.protocol.name}."
        f"{language}{calibration}"
    )


def _recorded_with(study: Path, found: StudyRows) -> Mapping[str, Any]:
    """Settings of the first recording, of trials that count, that can be read; none where there is none."""
    for row in found.counted or found.rows:
        if row.recording and row.block != PRACTICE:
            path = session_folder(study, row.participant, row.session) / Path(row.recording).name
            try:
                return read_session(path).settings
            except HighFiveError:
                continue
    return {}


def _live(value: str, otherwise: str) -> str:
    return "live" if value == "live" else otherwise


def _n(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _list(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else ""
