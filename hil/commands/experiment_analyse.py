"""``highfive experiment analyse``: what a study's answers say, as the source study tells it and with calibration."""

from __future__ import annotations

import json
import logging
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from highfive.hil.commands.experiment_trials import of_questionnaires, of_trials
from highfive.hil.experiments.analysis.answers import Answer, confusions_of, counts_of, fits_of, read_answers
from highfive.hil.experiments.analysis.confusion import Confusion, chance_bits, emotion_rates, mutual_information
from highfive.hil.experiments.analysis.contrasts import contrasts
from highfive.hil.experiments.analysis.counts import CONDITIONS, PersonCounts, read_counts
from highfive.hil.experiments.analysis.hierarchical import Effects, logit_differences, over_people
from highfive.hil.experiments.analysis.psychometric import Psychometric, pooled_log_jnd, pooled_pse, pse_shift
from highfive.hil.experiments.analysis.source_table import EMOTIONS, WARNING, SourceTable, source_table
from highfive.hil.experiments.exclusion import read_rules
from highfive.hil.experiments.recorded.interaction import SYNCHRONY, TIMING, interaction
from highfive.hil.experiments.recorded.methods import methods
from highfive.hil.experiments.recorded.xdf_events import events_csv, xdf_events
from highfive.hil.experiments.study import check_planned, participants, stored_plan
from highfive.hil.experiments.study_rows import answers_of, codes, study_rows, tidy_rows
from highfive.hil.runtime.console import Bar, say_aside
from highfive.hil.runtime.folders import results_folder, write_file
from highfive.model.errors import HighFiveError

OVERALL = "overall"
"""The table's last row, which is nobody's."""
ALL_TRIALS = "all_trials.csv"
"""In the results of a study: a row a trial, in all columns of the logs."""
METHODS = "methods.md"
"""There: a paragraph for a paper, with brackets where the lab fills in."""
XDF_EVENTS = "xdf_events.csv"
"""There: the log's events on the time lines of XDF files."""
SIMULATED = (
    "Table 1 of the source study is left out: it is of people, and all participants here are simulated. To rehearse "
    "it: highfive experiment analyse --trials, with the trials.csv beside this."
)


@dataclass(frozen=True)
class AnalyseOptions:
    """What to analyse.

    Attributes:
        study: folder of a study, whose logs are read; or
        counts: file with the columns ``participant,condition,correct,n``; or
        trials: one with ``participant,condition,emotion,answer`` and, of morphs, ``weight``.
        emotions: answers to choose from; None for as many as occur in the trials, or the source study's three.
        out: folder for page, figures and tidy table.
        overwrite: write there though something is there.
        level: of all intervals.
        questionnaires: files that say what was asked beside the trials, and where the answers are.
        exclude: file of the lab's own rules for what does not count; of a study's folder.
        xdf: files that were recorded beside its runs; of a study's folder.
    """

    counts: Path | None
    trials: Path | None = None
    emotions: int | None = None
    out: Path | None = None
    overwrite: bool = False
    study: Path | None = None
    level: float = 0.95
    questionnaires: tuple[Path, ...] = ()
    exclude: Path | None = None
    xdf: tuple[Path, ...] = ()


def analyse(options: AnalyseOptions, bar: Bar | None = None) -> dict[str, Any]:
    """The figures of a study, and its page if that is wanted; ``bar`` shows how far its recordings are read.

    Raises:
        HighFiveError: there is nothing to analyse, or it cannot be read, compared or written.
    """
    if options.counts is not None and options.trials is not None:
        raise HighFiveError("--counts and --trials are two ways to give the same answers; give one of them")
    if options.study is not None and (options.counts is not None or options.trials is not None):
        raise HighFiveError(f"{options.study} has its own answers; leave out --counts and --trials, or the folder")
    if (options.exclude is not None or options.xdf) and options.study is None:
        said = "--exclude has rules for the trials" if options.exclude is not None else "--xdf is of the runs"
        raise HighFiveError(f"{said} of a study; give its folder")
    if options.counts is None and options.trials is None and options.study is None:
        raise HighFiveError(
            "nothing to analyse; give a study's folder, or --counts FILE.csv with participant,condition,correct,n"
        )
    if options.out is None:
        return _of_study(options.study, options, bar)[0] if options.study else _study(options, *_read(options))
    with results_folder(options.out, options.overwrite):
        if options.study is not None:
            result, people, answers = _of_study(options.study, options, bar)
        else:
            people, answers = _read(options)
            result = _study(options, people, answers)
        from highfive.hil.report.experiment_report import write_experiment  # noqa: PLC0415 (draws, which takes a second)

        result["page"] = str(write_experiment(options.out, result, people, answers))
    return result


def _of_study(
    study: Path, options: AnalyseOptions, bar: Bar | None
) -> tuple[dict[str, Any], Sequence[PersonCounts], Sequence[Answer]]:
    """The figures of a study's folder, and what they are of."""
    rules = None if options.exclude is None else read_rules(options.exclude)
    found = study_rows(study, rules)
    for log in found.incomplete:
        say_aside(log.line, logging.WARNING)
    check_planned(study, found.protocol)
    for code in participants(study):
        stored_plan(study, code)  # one that was changed tells of other trials than were shown
    answers = answers_of(found)
    people, lacking = _compared(answers, str(study))
    options = replace(options, emotions=options.emotions or len(found.protocol.labels))
    result = _study(options, people, answers, codes(study, found.protocol))
    result["source"] = str(study)
    if found.simulated and "table" in result:
        result["table_refused"] = SIMULATED
        result["table"] = None
        del result["overall_warning"]
    beside = [xdf_events(path, found.rows) for path in options.xdf]
    if beside:
        result["xdf"] = [one.about for one in beside]
    if lacking:
        result["lacking"] = lacking
    if rules is not None:
        result["rules"] = {"file": rules.source, "digest": rules.digest}
    result |= {"hierarchical": result.get("hierarchical"), "psychometric": result.get("psychometric")}
    result["table"] = result.get("table")
    advance = bar("recordings", len(found.counted)) if bar is not None and found.counted else None
    moved = interaction(study, found.counted, advance)
    result |= of_trials(found, moved)
    result["excluded"] = [asdict(one) for one in found.excluded]
    result["incomplete_logs"] = [asdict(one) for one in found.incomplete]
    result["simulated"] = found.simulated
    result["software"] = list(found.software)
    result["trials"] = {"all": len(found.rows), "counted": len(found.counted)}
    if options.out is not None:
        tidy = tidy_rows(found.rows, found.excluded, (*TIMING, *SYNCHRONY), moved.figures)
        write_file(options.out / ALL_TRIALS, tidy)
        write_file(options.out / METHODS, methods(study, found, options.level, rules).encode())
        if beside:
            write_file(options.out / XDF_EVENTS, events_csv(beside))
    return result, people, answers


def _compared(answers: Sequence[Answer], study: str) -> tuple[Sequence[PersonCounts], str]:
    """The people of a study who can be compared, and in a line what is lacking to compare more."""
    if not answers:
        return [], ""
    there = {one.condition for one in answers}
    lacks = [name for name in CONDITIONS if name not in there]
    if lacks and there - set(CONDITIONS):
        return (
            [],
            f"{study} has no {lacks[0]} trials: the source study's table compares interactive ones and own replays",
        )
    try:
        people = counts_of([one for one in answers if one.condition in CONDITIONS], study, least=1)
        one = people[0].participant if len(people) == 1 else ""
    except HighFiveError as error:
        return [], str(error)
    return people, f"{study} holds one person, {one}; what differs between people needs two or more" if one else ""


def _read(options: AnalyseOptions) -> tuple[Sequence[PersonCounts], Sequence[Answer]]:
    if options.trials is not None:
        answers = read_answers(options.trials)
        return counts_of(answers, str(options.trials)), answers
    assert options.counts is not None
    return read_counts(options.counts), ()


def _study(
    options: AnalyseOptions, people: Sequence[PersonCounts], answers: Sequence[Answer],
    planned: Collection[str] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Of ``planned`` participants; None where nobody says who they are."""
    source = options.counts or options.trials
    result: dict[str, Any] = {"source": str(source), "level": options.level}
    matrices, fits = confusions_of(answers), fits_of(answers, options.level)
    if people:
        labels = {label for matrix in matrices.values() for label in matrix.emotions}
        if options.emotions is not None and options.emotions < len(labels):
            there = f"{len(labels)} ({', '.join(sorted(labels))})"
            raise HighFiveError(f"--emotions {options.emotions}: {source} has {there}; give that many or more")
        result |= recognition(people, options.emotions or len(labels) or EMOTIONS, options.level)
    if matrices:
        result["confusion"] = {condition: _confusion(matrix, options.level) for condition, matrix in matrices.items()}
    if found := contrasts(answers, options.level):
        result["contrasts"] = {condition: _plain(asdict(one)) for condition, one in found.items()}
    if fits:
        result["psychometric"] = _psychometric(fits, options.level)
    if options.questionnaires:
        result["questionnaires"] = of_questionnaires(options.questionnaires, planned)
    return result


def recognition(people: Sequence[PersonCounts], emotions: int, level: float = 0.95) -> dict[str, Any]:
    """Table and hierarchical estimate of right answers.

    Raises:
        HighFiveError: a person has the name of the table's last row.
    """
    if any(person.participant == OVERALL for person in people):
        raise HighFiveError(
            f"a participant is called {OVERALL}, as the table's last row is; give that one another code"
        )
    return {
        "people": len(people),
        "emotions": emotions,
        "table": _table(source_table(people, emotions)),
        "overall_warning": WARNING,
        "hierarchical": _effects(over_people(*logit_differences(people), level)) if len(people) > 1 else None,
    }


def print_analysis(result: dict[str, Any]) -> None:
    """The same for people."""
    if "table" in result and (result["table"] is not None or "table_refused" in result):
        _print_recognition(result)
    if "lacking" in result:
        print(result["lacking"])
    for condition, found in result.get("confusion", {}).items():
        rates = "; ".join(
            f"{name} {rate['correct']} of {rate['shown']} right, estimate {rate['mean']:.2f}"
            for name, rate in found["emotions"].items()
        )
        print(f"{condition}: {rates}; {found['mutual_information']:.2f} bits (blind: {found['chance_bits']:.2f})")
    for condition, found in result.get("contrasts", {}).items():
        _print_contrast(condition, found)
    for condition, found in (result.get("psychometric") or {}).get("conditions", {}).items():
        for person, one in found["people"].items():
            low, high = one["pse"]["interval"]
            print(f"{condition} {person}: PSE {one['pse']['value']:.3f} ({low:.3f} to {high:.3f}), "
                  f"JND {one['jnd']['value']:.3f}")  # fmt: skip
    if shift := (result.get("psychometric") or {}).get("pse_shift"):
        low, high = shift["interval"]
        print(
            f"Shift of the PSE, interactive − replay: {shift['mean']:+.3f} ({100.0 * shift['level']:g}% interval "
            f"{low:+.3f} to {high:+.3f}), P that it is above 0: {shift['p_positive']:.3f}"
        )
    for name, asked in result.get("questionnaires", {}).items():
        _print_questionnaire(name, asked)
    if "timing" in result:
        _print_study(result)
    if "page" in result:
        print(f"Open {result['page']}")


def _print_study(result: dict[str, Any]) -> None:
    planned = " (the program's: nobody moved)" if result["simulated"] and not result["motion"]["trials"] else ""
    for condition, times in result["timing"].items():
        reaction, contact = times["reaction_s"], times["contact_after_cue_s"]
        met = "" if contact["median"] is None else f", contact {contact['median']:.2f} s after the cue{planned}"
        print(f"{condition}: {reaction['n']} answers, median reaction {reaction['median'] or 0.0:.2f} s{met}")
        if "asynchrony_s" in times:
            print(f"  palms: asynchrony {1e3 * times['asynchrony_s']['median']:+.1f} ms, closing at "
                  f"{times['closing_speed']['median']:.2f} m/s ({times['asynchrony_s']['n']} contacts)")  # fmt: skip
        if "share_below" in times:
            share = 100.0 * times["share_below"]["median"]
            print(f"  synchrony: {times['synchrony']['median']:.2f}, above {share:.0f}% of its pseudo-pairs "
                  f"({times['share_below']['n']} trials)")  # fmt: skip
    for one in result.get("xdf", []):
        print(f"{one['file']}: {one['matched']} contacts are markers of it, {one['events']} events on its time line")
    why = Counter(one["why"] for one in result["excluded"])
    for reason, count in why.most_common():
        print(f"not counted: {count} of {result['trials']['all']} trials: {reason}")
    if len(result["software"]) > 1:
        print(f"versions are mixed: {', '.join(result['software'])}")
    if result["simulated"]:
        print("All of it is of simulated participants.")


def _print_questionnaire(name: str, asked: dict[str, Any]) -> None:
    for subscale, conditions in asked["subscales"].items():
        for condition, one in conditions.items():
            mean = "no score" if one["mean"] is None else f"{one['mean']:.2f}"
            print(f"{name}, {subscale}{condition and ', '}{condition}: {mean} ({one['n']} people)")


def _print_contrast(condition: str, found: dict[str, Any]) -> None:
    rates = ", ".join(f"{name} {rate:.3f}" for name, rate in found["rates"].items())
    effects = found["effects"]
    if effects is None:
        print(f"{rates} right, of one person")
        return
    low, high = effects["interval"]
    print(
        f"{rates} right, of {found['people']} people: interactive − {condition} is {effects['mean']:+.2f} logit "
        f"({100.0 * effects['level']:g}% interval {low:+.2f} to {high:+.2f}), P that it is above 0: "
        f"{effects['p_positive']:.3f}"
    )


def _print_recognition(result: dict[str, Any]) -> None:
    if result["table"] is None:
        print(result["table_refused"])
    else:
        _print_table(result)
    if (found := result["hierarchical"]) is None:
        return
    low, high = found["interval"]
    print(
        f"Calibrated: interactive − replay is {found['mean']:+.2f} logit ({100.0 * found['level']:g}% interval "
        f"{low:+.2f} to {high:+.2f}), P that it is above 0: {found['p_positive']:.3f}; "
        f"between people {found['between']:.2f}"
    )


def _print_table(result: dict[str, Any]) -> None:
    print("Table 1 of the source study, by its own rules (mean ± SE of the rate; P that it is higher in interaction):")
    print(f"  {'':12}{'interactive':>15}{'replay':>15}{'P':>7}")
    for name, row in result["table"].items():
        if name != OVERALL:
            rates = "".join(f"{row[c]['mean']:>7.3f} ± {row[c]['se']:.3f}" for c in CONDITIONS)
            print(f"  {name:12}{rates}{row['p_interactive_higher']:>7.3f}")
    print(f"  {'overall P':12}{'':30}{result['table'][OVERALL]:>7.3f}")
    print(f"  {result['overall_warning']}")


def _table(table: SourceTable) -> dict[str, Any]:
    rows: dict[str, Any] = {
        row.participant: {
            "interactive": asdict(row.interactive),
            "replay": asdict(row.replay),
            "p_interactive_higher": row.p_interactive_higher,
        }
        for row in table.rows
    }
    return rows | {OVERALL: table.overall}


def _confusion(matrix: Confusion, level: float) -> dict[str, Any]:
    rates = {rate.emotion: _plain(asdict(rate)) for rate in emotion_rates(matrix, level)}
    return {
        "labels": list(matrix.emotions),
        "counts": matrix.counts.tolist(),
        "emotions": rates,
        "mutual_information": mutual_information(matrix),
        "chance_bits": chance_bits(matrix),
    }


def _psychometric(fits: Mapping[str, Mapping[str, Psychometric]], level: float) -> dict[str, Any]:
    conditions: dict[str, Any] = {}
    for condition, found in fits.items():
        here: dict[str, Any] = {"people": {person: _plain(asdict(one)) for person, one in found.items()}}
        if len(found) > 1:
            together = list(found.values())
            here["pooled_pse"] = _effects(pooled_pse(together, level))
            here["pooled_log_jnd"] = _effects(pooled_log_jnd(together, level))
        conditions[condition] = here
    both = [person for person in fits.get(CONDITIONS[0], {}) if person in fits.get(CONDITIONS[1], {})]
    result: dict[str, Any] = {"conditions": conditions}
    if len(both) > 1:
        first, second = ([fits[condition][person] for person in both] for condition in CONDITIONS)
        result["pse_shift"] = _effects(pse_shift(first, second, level))
    return result


def _effects(effects: Effects) -> dict[str, Any]:
    return _plain(asdict(effects))


def _plain(value: dict[str, Any]) -> dict[str, Any]:
    """As JSON has it: tuples as lists."""
    plain: dict[str, Any] = json.loads(json.dumps(value))
    return plain
