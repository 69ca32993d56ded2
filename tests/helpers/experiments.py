"""Experiments for tests: templates with something changed, studies, and sessions in which all is answered rightly."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from highfive.hil.experiments.plan import draw_plans
from highfive.hil.experiments.protocol import Protocol
from highfive.hil.experiments.protocol_file import TEMPLATES, read_protocol
from highfive.hil.experiments.study import check_plans, write_study, write_template
from highfive.hil.experiments.trial_log import RunHead, TrialLog
from highfive.hil.experiments.trial_row import Outcome


def protocol(name: str, **changes: object) -> Protocol:
    """A template's, with other fields."""
    return replace(read_protocol(TEMPLATES / f"{name}.toml"), **changes)  # pyright: ignore[reportArgumentType]


def written(folder: Path, name: str, changes: Mapping[str, str] | None = None) -> Path:
    """A template's file in a folder, with texts replaced."""
    path = folder / f"{name}.toml"
    write_template(name, path, overwrite=True)
    text = path.read_text(encoding="utf-8")
    for old, new in (changes or {}).items():
        assert old in text, old
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return path


def study(folder: Path, name: str = "tipping", changes: Mapping[str, str] | None = None) -> Path:
    """A study of a template, of two people: each file waits for the disk."""
    path = written(folder, name, changes or {"participants = 12": "participants = 2"})
    asked = read_protocol(path)
    plans = check_plans(folder / "study", draw_plans(asked))
    write_study(folder / "study", path, asked, plans)
    return folder / "study"


def head(participant: str = "P01", session: int = 1, software: str = "1.0", consent: str = "1") -> RunHead:
    return RunHead(participant, session, consent, software, "cal", simulated=True)


def answer(log: TrialLog, count: int = 10_000, **outcome: object) -> int:
    """Answers the next trials rightly; how many there were."""
    for done in range(count):
        trial = log.begin()
        if trial is None:
            return done
        log.finish(Outcome(**{"answer": trial.answer, **outcome}))  # pyright: ignore[reportArgumentType]
    return count
