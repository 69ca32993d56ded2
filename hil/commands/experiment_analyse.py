"""``highfive experiment analyse``: what a study's answers say, as the source study tells it and with calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from highfive.hil.experiments.analysis.counts import PersonCounts, read_counts
from highfive.hil.experiments.analysis.hierarchical import Effects, logit_differences, over_people
from highfive.hil.experiments.analysis.source_table import EMOTIONS, WARNING, SourceTable, source_table
from highfive.model.errors import HighFiveError

OVERALL = "overall"
"""The table's last row, which is nobody's."""


@dataclass(frozen=True)
class AnalyseOptions:
    """What to analyse.

    Attributes:
        counts: file with the columns ``participant,condition,correct,n``.
        emotions: answers to choose from.
    """

    counts: Path | None
    emotions: int = EMOTIONS


def analyse(options: AnalyseOptions) -> dict[str, Any]:
    """The figures of a study.

    Raises:
        HighFiveError: there is nothing to analyse, or it cannot be read or compared.
    """
    if options.counts is None:
        raise HighFiveError("nothing to analyse; give --counts FILE.csv with participant,condition,correct,n")
    return recognition(read_counts(options.counts), options.emotions)


def recognition(people: Sequence[PersonCounts], emotions: int) -> dict[str, Any]:
    """Table and hierarchical estimate of right answers.

    Raises:
        HighFiveError: a person has the name of the table's last row.
    """
    if any(person.participant == OVERALL for person in people):
        raise HighFiveError(
            f"a participant is called {OVERALL}, as the table's last row is; give that one another code"
        )
    effects = over_people(*logit_differences(people))
    return {
        "people": len(people),
        "emotions": emotions,
        "table": _table(source_table(people, emotions)),
        "overall_warning": WARNING,
        "hierarchical": _effects(effects),
    }


def print_analysis(result: dict[str, Any]) -> None:
    """The same for people."""
    print("Table 1 of the source study, by its own rules (mean ± SE of the rate; P that it is higher in interaction):")
    print(f"  {'':12}{'interactive':>15}{'replay':>15}{'P':>7}")
    for name, row in result["table"].items():
        if name != OVERALL:
            rates = "".join(f"{row[c]['mean']:>7.3f} ± {row[c]['se']:.3f}" for c in ("interactive", "replay"))
            print(f"  {name:12}{rates}{row['p_interactive_higher']:>7.3f}")
    print(f"  {'overall P':12}{'':30}{result['table'][OVERALL]:>7.3f}")
    print(f"  {result['overall_warning']}")
    found = result["hierarchical"]
    low, high = found["interval"]
    print(
        f"Calibrated: interactive − replay is {found['mean']:+.2f} logit ({found['level']:.0%} interval {low:+.2f} to "
        f"{high:+.2f}), P that it is above 0: {found['p_positive']:.3f}; between people {found['between']:.2f}"
    )


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


def _effects(effects: Effects) -> dict[str, Any]:
    return asdict(effects) | {"interval": list(effects.interval)}
