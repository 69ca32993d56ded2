"""What a study's folder holds beside its TOML files, damaged: a session's log, and what plans were drawn from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

from highfive.hil.bench.fuzz_mutations import damaged_json, damaged_text
from highfive.hil.bench.fuzz_reader import Seed, of_file
from highfive.hil.experiments.plan import draw_plans
from highfive.hil.experiments.protocol_file import TEMPLATES, read_protocol
from highfive.hil.experiments.study import LOG, PLANNED, check_planned, session_folder, write_study
from highfive.hil.experiments.trial_log import RunHead, open_log, read_session
from highfive.hil.experiments.trial_row import Outcome

_WHO = "P01"


def study_seeds() -> list[Seed]:
    """A log of two runs, the first of which broke off; and ``planned.json``."""
    source = TEMPLATES / "tipping.toml"
    protocol = replace(read_protocol(source), participants=1)
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_study(folder, source, protocol, draw_plans(protocol))
        head = RunHead(_WHO, 1, protocol.consent, "1.0", simulated=True)
        for resume in (False, True):
            with open_log(folder, head, resume) as log:
                for _ in range(2):
                    trial = log.begin()
                    log.finish(Outcome(answer="" if trial is None else trial.answer, rt_s=0.5))
                log.begin()
        content = (session_folder(folder, _WHO, 1) / LOG).read_bytes()
        planned = (folder / PLANNED).read_bytes()
    check = of_file(PLANNED, lambda path: check_planned(path.parent, protocol))
    return [Seed(content, _log, _damaged_log), Seed(planned, check, damaged_json)]


def _log(content: bytes, folder: Path) -> Any:
    path = session_folder(folder, _WHO, 1) / LOG
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return read_session(folder, _WHO, 1).rows


def _damaged_log(rng: Random, content: bytes, others: Sequence[bytes]) -> bytes:
    """Within a line, as JSON; a third as text."""
    if rng.random() < 0.33:
        return damaged_text(rng, content, others)
    lines = content.splitlines()
    place = rng.randrange(len(lines))
    lines[place] = damaged_json(rng, lines[place], lines)
    return b"\n".join(lines) + b"\n"
