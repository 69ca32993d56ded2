"""The log of a session's trials: append-only, each row on the disk before the next trial begins.

Other programs that write as they exit lost whole sessions to a crash. Here every line is written in one piece, and
waited for until it is safe on the disk (``fsync``). A line that a crash tore is kept beside the log and cut off.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from highfive.hil.experiments import log_content
from highfive.hil.experiments.log_content import LogContent, read_log, torn_end, whole_lines
from highfive.hil.experiments.plan import Plan, PlannedTrial
from highfive.hil.experiments.plan_file import difference
from highfive.hil.experiments.protocol import ADAPTIVE
from highfive.hil.experiments.study import LOG, participant_folder, session_folder, stored_plan
from highfive.hil.experiments.trial_row import Outcome, TrialRow
from highfive.hil.runtime.clock import MACHINE, Clock, utc_ns
from highfive.hil.runtime.folders import locked
from highfive.model.errors import HighFiveError
from highfive.model.files import read_bounded

S = 1_000_000_000
MOST_BYTES = 8 << 20
"""Largest log that is read: a trial has a kilobyte."""


@dataclass(frozen=True)
class RunHead:
    """What is the same in all rows of a run.

    Attributes:
        participant, session: who, and which of her sessions, from 1.
        consent: version of the form that she signed; empty if she did not.
        software: version.
        calibration: hash of what is in use.
        simulated: no person answers.
        language: of the instructions and the page.
    """

    participant: str
    session: int
    consent: str
    software: str
    calibration: str = ""
    simulated: bool = False
    language: str = ""


class TrialLog:
    """A session's log, open for one run; made by :func:`open_log`.

    Attributes:
        plan: what is asked.
        path: of the log.
        told: what the experimenter should know: a torn line, other versions, a block that begins again.
    """

    def __init__(
        self, path: Path, plan: Plan, head: RunHead, missing: frozenset[str], clock: Clock, told: list[str]
    ) -> None:
        """Opens the file, which has been looked at, and begins a run.

        Raises:
            HighFiveError: it cannot be written.
        """
        self.path, self.plan, self.told = path, plan, told
        self._head, self._missing, self._clock = head, missing, clock
        self._asked: PlannedTrial | None = None
        self._ask = self._begun_utc = 0
        self._last_ns: int | None = None
        try:
            self._file = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o666)
            self._size = os.fstat(self._file).st_size
            self._content = read_log(read_bounded(path, MOST_BYTES), str(path))
        except OSError as error:
            raise HighFiveError(f"cannot write the trial log {path}: {error.strerror or error}") from None
        try:
            self._begin_run()
        except BaseException:
            self.close()
            raise

    def _begin_run(self) -> None:
        others = [version for version in self._content.software if version != self._head.software]
        if others:
            self.told.append(
                f"versions are mixed: this session was begun with {', '.join(others)}, now it is "
                f"{self._head.software}; each row says its own"
            )
        head = {name: value for name, value in asdict(self._head).items() if name not in ("participant", "session")}
        run = {"kind": "run", **head, "digest": self.plan.digest, "plan": asdict(self.plan), "utc_ns": utc_ns()}
        self._append(run)
        _sync_folder(self.path.parent)
        if block := log_content.interrupted_block(self.plan, self._content, self._missing):
            self._again(block, "the run stopped inside the block, which began again")

    @property
    def content(self) -> LogContent:
        """What it holds."""
        return self._content

    @property
    def left(self) -> list[PlannedTrial]:
        """The trials that are still to be asked, in order."""
        return log_content.trials_left(self.plan, self._content, self._missing)

    @property
    def following(self) -> PlannedTrial | None:
        """The trial that is to be asked next; None once there is none."""
        return next(iter(self.left), None)

    @property
    def ask(self) -> int:
        """The how manieth trial of the session the last one that began is, from 1; 0 before the first."""
        return self._ask

    def begin(self) -> PlannedTrial | None:
        """The next trial begins: from now on it was asked, whatever happens. None once there is none.

        After too long a pause inside a block that is the block's first one.

        Raises:
            HighFiveError: another one is not over; it cannot be written.
        """
        if self._asked is not None:
            raise HighFiveError(f"trial {self._asked.name} is not over; finish it, or break it off")
        trial = self.following
        if trial is not None and self._last_ns is not None:
            paused_s = (self._clock.now() - self._last_ns) / S
            inside = log_content.block_asks(self.plan, self._content, trial.block)
            if inside and paused_s > self.plan.pause_s:
                self._again(trial.block, f"a pause of {paused_s / 60.0:.0f} min inside the block, which began again")
                trial = self.following
        if trial is None:
            return None
        self._ask, self._begun_utc = max(self._content.asks, default=0) + 1, utc_ns()
        self._append({"kind": "begin", "ask": self._ask, "trial": trial.name, "utc_ns": self._begun_utc})
        self._asked = trial
        return trial

    def finish(self, outcome: Outcome) -> TrialRow:
        """The trial is over, and on the disk when this returns.

        Raises:
            HighFiveError: none has begun; an answer, weights or numbers that cannot be; it cannot be written.
        """
        if (trial := self._asked) is None:
            raise HighFiveError("no trial has begun; nothing is over")
        self._check(trial, outcome)
        replayed = trial.source != ""
        row = TrialRow(
            **{**vars(outcome), "weights": dict(outcome.weights or trial.weights)},
            ask=self._ask, participant=self.plan.participant, session=self._head.session,
            block=trial.block, trial=trial.name, condition=trial.mode, style=trial.style, expected=trial.answer,
            cell=trial.cell, clip=trial.clip, source_trial=trial.source,
            viewpoint=self.plan.viewpoint if replayed else "live", own_arm=self.plan.own_arm if replayed else "live",
            software=self._head.software, seed=self.plan.seed, calibration=self._head.calibration,
            simulated=self._head.simulated, language=self._head.language, begun_utc_ns=self._begun_utc, utc_ns=utc_ns(),
        )  # fmt: skip
        self._append({"kind": "trial", **asdict(row)})
        self._asked, self._last_ns = None, self._clock.now()
        return row

    def _check(self, trial: PlannedTrial, outcome: Outcome) -> None:
        if outcome.answer not in ("", *self.plan.keys):
            raise HighFiveError(f"trial {trial.name}: answer {outcome.answer!r}, expected {', '.join(self.plan.keys)}")
        if outcome.certainty is not None and not 0.0 <= outcome.certainty <= 1.0:
            raise HighFiveError(f"trial {trial.name}: certainty is {outcome.certainty}, expected 0 to 1")
        if outcome.weights and dict(outcome.weights) != dict(trial.weights) and trial.style != ADAPTIVE:
            raise HighFiveError(f"trial {trial.name}: weights {outcome.weights}, the plan has {trial.weights}")

    def close(self) -> None:
        """No more rows."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _again(self, block: str, why: str) -> None:
        asks = log_content.block_asks(self.plan, self._content, block)
        self._append({"kind": "mark", "asks": asks, "why": why, "utc_ns": utc_ns()})
        self.told.append(f"block {block} begins again, its {len(asks)} trials are marked: {why}")

    def _append(self, entry: Mapping[str, Any]) -> None:
        """A line, safe on the disk; all of it or nothing."""
        try:
            line = (json.dumps(entry, ensure_ascii=False, allow_nan=False) + "\n").encode()
            # What it says is what reading it back will say: a row that could not be read is not written.
            content = log_content.read_line(line, "the row")
        except ValueError as error:
            raise HighFiveError(f"this row cannot be written: {error}") from None
        try:
            _write_all(self._file, line)
            os.fsync(self._file)
        except OSError as error:
            with suppress(OSError):
                os.ftruncate(self._file, self._size)
            raise HighFiveError(
                f"not on the disk: a row of {self.path}: {error.strerror or error}; make room, and resume"
            ) from None
        self._size += len(line)
        self._content = log_content.joined(self._content, content)


@contextmanager
def open_log(
    study: Path, head: RunHead, resume: bool, clock: Clock = MACHINE, ready: Callable[[], None] = lambda: None
) -> Iterator[TrialLog]:
    """Opens a participant's session; meanwhile no other run may write to the study.

    Args:
        study: its folder.
        head: who, and with what.
        resume: go on with a session that has begun.
        clock: by which pauses are measured.
        ready: called once nothing here refuses the run and before it is written that it began: what else may refuse it
            does so there, and leaves no session.

    Raises:
        HighFiveError: the session has begun already, or not, as it should; another run is going on; she did not consent
            to this version; her plan was changed after the first run; whom she is shown has not taken part; the log is
            damaged, or cannot be written.
    """
    plan = stored_plan(study, head.participant)
    if head.consent != plan.consent:
        raise HighFiveError(
            f"{head.participant} signed consent form {head.consent or 'none'}, expected version {plan.consent}; have "
            "that one signed first"
        )
    with locked(study) as free:
        if free is False:
            raise HighFiveError(f"another run is writing to {study}; wait until it is over")
        path = session_folder(study, head.participant, head.session) / LOG
        told = [] if free else [f"{study} is on a file system without locks: see to it that no other run writes there"]
        try:
            content = _looked_at(path, told)
        except OSError as error:
            raise HighFiveError(f"cannot open the trial log {path}: {error.strerror or error}") from None
        _check_begun(content, plan, head, resume, path)
        for other in sorted(participant_folder(study, head.participant).glob(f"session-*/{LOG}")):
            _check_plan(_read(other), plan, other)
        missing = missing_sources(study, plan, content)
        ready()
        try:
            path.parent.mkdir(parents=True, exist_ok=True)  # after all that may refuse: no empty session stays
        except OSError as error:
            raise HighFiveError(f"cannot open the trial log {path}: {error.strerror or error}") from None
        log = TrialLog(path, plan, head, missing, clock, told)
        try:
            yield log
        finally:
            log.close()


def read_session(study: Path, code: str, session: int) -> LogContent:
    """What a participant's session holds, also while it runs; what a crash tore is left out, and said in ``torn``.

    Raises:
        HighFiveError: it has not begun, or its log is damaged.
    """
    path = session_folder(study, code, session) / LOG
    if not path.exists():
        raise HighFiveError(f"{code} has no session {session} in {study}")
    content = _read(path)
    if content.plan is not None and content.plan.participant != code:
        raise HighFiveError(f"{path} is of {content.plan.participant}, in the folder of {code}; move it where it was")
    if strange := [row for row in content.finished if row.session != session]:
        raise HighFiveError(f"{path} is of session {strange[0].session}; a copy counts its trials twice: move it away")
    return content


def source_row(study: Path, log: TrialLog, name: str) -> TrialRow:
    """The row of a trial that is shown again: of her own session, or of another's newest one (``P03:I1-07``).

    Raises:
        HighFiveError: there is none.
    """
    code, own, trial = name.rpartition(":")
    if not own:
        rows = log.content.standing
    else:
        paths = sorted(participant_folder(study, code).glob(f"session-*/{LOG}"), key=session_number)
        rows = [row for path in paths for row in _read(path).standing]
    found = [row for row in rows if row.trial == trial and not row.broken_off]
    if not found:
        raise HighFiveError(f"trial {name} is to be shown again, and is in no log; has its participant been deleted?")
    return found[-1]


def session_number(log: Path) -> int:
    """Of the session that a log is of.

    Raises:
        HighFiveError: its folder is called otherwise.
    """
    number = log.parent.name.removeprefix("session-")
    if not (number.isascii() and number.isdecimal()):
        raise HighFiveError(f"{log.parent} is no session's folder, expected session-1 and so on; move it away")
    return int(number)


def missing_sources(study: Path, plan: Plan, content: LogContent) -> frozenset[str]:
    """Other people's trials of the plan that there are not: never played, or broken off.

    Raises:
        HighFiveError: there is none of them, and never was by the ``content`` of her log.
    """
    wanted = {trial.source for trial in plan.trials if ":" in trial.source}
    there: set[str] = set()
    for code in {source.partition(":")[0] for source in wanted}:
        for path in participant_folder(study, code).glob(f"session-*/{LOG}"):
            there |= {f"{code}:{row.trial}" for row in _read(path).standing if not row.broken_off}
    seen = {row.source_trial for row in content.rows}
    if wanted and not wanted & (there | seen):
        code = min(wanted).partition(":")[0]
        raise HighFiveError(
            f"{plan.participant} is shown the trials of {code}, who has none yet; let {code} take part first"
        )
    return frozenset(wanted - there)


def _read(path: Path) -> LogContent:
    try:
        content = read_bounded(path, MOST_BYTES)
    except OSError as error:
        raise HighFiveError(f"cannot read the trial log {path}: {error.strerror or error}") from None
    return replace(read_log(content[: whole_lines(content)], str(path)), torn=torn_end(content))


def _looked_at(path: Path, told: list[str]) -> LogContent:
    """The log's content; what a crash left behind the last whole line goes into a file beside."""
    if not path.exists():
        return LogContent()
    content = read_bounded(path, MOST_BYTES)
    size = whole_lines(content)
    if size < len(content):
        number = 1 + len(list(path.parent.glob(f"{path.name}.torn-*")))
        aside = path.with_name(f"{path.name}.torn-{number}")
        with aside.open("xb") as file:
            file.write(content[size:])
            file.flush()
            os.fsync(file.fileno())
        with path.open("rb+") as file:
            file.truncate(size)
            os.fsync(file.fileno())
        told.append(f"the last line of {path} was torn: {len(content) - size} bytes are in {aside.name} now")
    return read_log(content[:size], str(path))


def _check_begun(content: LogContent, plan: Plan, head: RunHead, resume: bool, path: Path) -> None:
    begun = content.plan is not None
    if begun and not resume:
        raise HighFiveError(
            f"{head.participant} has session {head.session} already: {len(content.standing)} of {len(plan.trials)} "
            f"trials in {path}; resume it (--resume), or give another participant"
        )
    if resume and not begun:
        raise HighFiveError(f"{head.participant} has no session {head.session} to resume; start it")
    if begun and content.simulated is not head.simulated:
        was, now = ("a person", "a simulated participant")[:: -1 if content.simulated else 1]
        raise HighFiveError(
            f"session {head.session} of {head.participant} is that of {was}, and {now} does not go on with it: give "
            "another participant"
        )


def _check_plan(content: LogContent, plan: Plan, path: Path) -> None:
    if content.plan is not None and (changed := difference(content.plan, plan)):
        raise HighFiveError(
            f"the plan of {plan.participant} was changed after the first run ({path}): {changed}; take it as it was"
        )


def _write_all(file: int, line: bytes) -> None:
    while line:
        line = line[os.write(file, line) :]


def _sync_folder(folder: Path) -> None:
    """Makes the names of new files safe, where the system can: of the folder, and those above it that may be new."""
    for place in _upwards(folder, 4):
        with suppress(OSError):
            descriptor = os.open(place, os.O_RDONLY)
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)


def _upwards(folder: Path, count: int) -> Iterable[Path]:
    return (folder, *folder.parents)[:count]
