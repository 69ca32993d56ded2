"""The log of trials: nothing that was finished is lost, nothing is asked twice unmarked."""

import fcntl
import json
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from disk import files_no_larger_than
from experiments import answer, head, study

from highfive.hil.experiments.forget import forget
from highfive.hil.experiments.log_content import read_log
from highfive.hil.experiments.study import stored_plan
from highfive.hil.experiments.study_rows import study_rows
from highfive.hil.experiments.trial_log import open_log, read_session
from highfive.hil.experiments.trial_row import COLUMNS, Outcome
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.model.errors import HighFiveError


@pytest.fixture
def tipping(tmp_path: Path) -> Path:
    return study(tmp_path)


def log_path(folder: Path, session: int = 1) -> Path:
    return folder / "participants" / "P01" / f"session-{session}" / "trials.jsonl"


def test_a_session_has_every_trial_of_its_plan_once_in_order(tipping: Path) -> None:
    with open_log(tipping, head(), resume=False) as log:
        assert answer(log) == len(log.plan.trials) == 87
    content = read_session(tipping, "P01", 1)
    assert [row.trial for row in content.rows] == [trial.name for trial in stored_plan(tipping, "P01").trials]
    assert [row.ask for row in content.rows] == list(range(1, 88))
    row = json.loads(log_path(tipping).read_text().splitlines()[2])
    assert row.pop("kind") == "trial" and set(row) == set(COLUMNS)
    assert (row["participant"], row["software"], row["calibration"], row["simulated"]) == ("P01", "1.0", "cal", True)


def test_what_is_written_is_what_is_read(tipping: Path) -> None:
    outcome = Outcome(
        answer="angry", key="2", rt_s=0.25, certainty=0.5, ratings={"valence": 1.0}, peak_speed=2.5, cue_ns=10**18,
        shown_ns=7, notes='zögerte \u2028 "laut"\n', broken_off="", excluded_why="late",
    )  # fmt: skip
    with open_log(tipping, head(), resume=False) as log:
        log.begin()
        row = log.finish(outcome)
    assert read_session(tipping, "P01", 1).rows == [row]
    assert (row.notes, row.cue_ns, row.ratings) == (outcome.notes, outcome.cue_ns, outcome.ratings)


def test_a_row_is_on_the_disk_before_the_next_trial_begins(tipping: Path) -> None:
    with open_log(tipping, head(), resume=False) as log:
        for count in range(1, 4):
            answer(log, 1)
            assert len(read_session(tipping, "P01", 1).rows) == count


@pytest.mark.parametrize(("inside", "marked"), [(3, 0), (15, 0), (9, 6), (2, 2), (4, 1)])
def test_resumed_inside_a_block_the_block_begins_again_and_its_rows_are_marked(
    tipping: Path, inside: int, marked: int
) -> None:
    """Practice has 3 trials, blocks have 12."""
    with open_log(tipping, head(), resume=False) as log:
        answer(log, inside)
    with open_log(tipping, head(), resume=True) as log:
        assert len(log.content.marked or {}) == marked
        assert bool(log.told) == (marked > 0)
        answer(log)
    rows = read_session(tipping, "P01", 1).rows
    assert [row.trial for row in rows if not row.excluded_why] == [trial.name for trial in log.plan.trials]
    again = [row for row in rows if row.excluded_why]
    assert len(again) == marked and all("began again" in row.excluded_why for row in again)


def test_a_trial_that_was_begun_and_not_finished_is_marked(tipping: Path) -> None:
    """Also the first of a block, before which the run stopped between two blocks."""
    with open_log(tipping, head(), resume=False) as log:
        answer(log, 3)
        assert log.begin() == log.plan.trials[3]
    with open_log(tipping, head(), resume=True) as log:
        assert list(log.content.marked or {}) == [4]
        assert log.begin() == log.plan.trials[3]


def test_after_a_pause_of_more_than_ten_minutes_the_block_begins_again(tipping: Path) -> None:
    with VirtualClock() as clock, open_log(tipping, head(), False, clock) as log:
        answer(log, 8)
        clock.wait_until(clock.now() + 599_000_000_000)
        answer(log, 1)
        assert not log.content.marked
        clock.wait_until(clock.now() + 601_000_000_000)
        trial = log.begin()
        assert trial is not None and trial.name == "I1-01"
        assert sorted(log.content.marked or {}) == list(range(4, 10))
        assert "10 min" in log.told[-1]


def test_a_pause_between_two_blocks_repeats_nothing(tipping: Path) -> None:
    with VirtualClock() as clock, open_log(tipping, head(), False, clock) as log:
        answer(log, 15)
        clock.wait_until(clock.now() + 3_600_000_000_000)
        trial = log.begin()
        assert trial is not None and trial.name == "I2-01" and not log.content.marked


def test_replays_of_what_was_broken_off_are_not_asked(tipping: Path) -> None:
    with open_log(tipping, head(), resume=False) as log:
        answer(log, 3)
        answer(log, 1, broken_off="marker lost", answer="")
        answer(log)
    rows = Counter(row.trial for row in read_session(tipping, "P01", 1).rows)
    (missing,) = {trial.name for trial in log.plan.trials} - set(rows)
    assert next(trial.source for trial in log.plan.trials if trial.name == missing) == "I1-01"


def test_another_ones_trials_are_needed_and_the_broken_off_ones_left_out(tmp_path: Path) -> None:
    folder = study(tmp_path, "high_five")
    none = pytest.raises(HighFiveError, match="P01 is shown the trials of P00, who has none yet")
    with none, open_log(folder, head(), resume=False):
        pass
    with open_log(folder, head("P00"), resume=False) as log:
        assert answer(log, 4) == 4
        answer(log, 1, broken_off="x")
        assert 5 + answer(log) == 40
    with open_log(folder, head(), resume=False) as log:
        assert answer(log) == 87
    forget(folder, "P00")
    with open_log(folder, head(), resume=True) as log:  # she is through: nobody's trials are needed any more
        assert answer(log) == 0 and log.left == []
    shown = {row.source_trial for row in read_session(folder, "P01", 1).rows if row.source_trial}
    assert "P00:I1-01" not in shown and {f"P00:I1-{number:02d}" for number in range(2, 13)} <= shown


def test_logs_of_before_there_was_a_language_are_read(tipping: Path) -> None:
    with open_log(tipping, replace(head(), language="de"), resume=False) as log:
        answer(log, 3, longest_gap_s=0.01)
    path = log_path(tipping)
    rows = read_session(tipping, "P01", 1).rows
    assert {(row.language, row.longest_gap_s) for row in rows} == {("de", 0.01)}
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    for line in lines:
        for name in ("language", "motion_s", "longest_gap_s"):
            line.pop(name, None)
    path.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    assert [replace(row, language="", longest_gap_s=None) for row in rows] == read_session(tipping, "P01", 1).rows


@pytest.mark.parametrize(
    ("resume", "who", "message"),
    [
        (False, head(), "P01 has session 1 already: 5 of 87 trials in .*; resume it"),
        (True, head("P02"), "P02 has no session 1 to resume; start it"),
        (False, head("P99"), "P99 has no plan .*; planned are P01, P02;"),
        (False, head("Anna Maier"), "expected a code of 2 to 12 letters and digits"),
        (False, head("../x"), "expected a code"),
        (True, replace(head(), simulated=False), "of P01 is that of a simulated participant, and a person does not"),
        (False, head("P02", consent="0"), "P02 signed consent form 0, expected version 1"),
        (False, head("P02", consent=""), "P02 signed consent form none"),
    ],
)
def test_what_cannot_be_opened_is_said_in_a_line(tipping: Path, resume: bool, who, message: str) -> None:
    with open_log(tipping, head(), resume=False) as log:
        answer(log, 5)
    before, there = log_path(tipping).read_bytes(), sorted(tipping.rglob("*"))
    with pytest.raises(HighFiveError, match=message) as told, open_log(tipping, who, resume):
        pass
    assert sorted(tipping.rglob("*")) == there  # no empty session stays behind
    assert "\n" not in str(told.value)
    assert log_path(tipping).read_bytes() == before


def test_another_session_of_the_same_person_is_another_log(tipping: Path) -> None:
    with open_log(tipping, head(), resume=False) as log:
        answer(log, 5)
    with open_log(tipping, head(session=2), resume=False) as log:
        answer(log, 3)
    assert [len(read_session(tipping, "P01", session).rows) for session in (1, 2)] == [5, 3]


def test_a_plan_changed_after_the_first_run_is_refused_with_the_difference(tipping: Path) -> None:
    """Also where its digest was made to fit, and for another session."""
    with open_log(tipping, head(), resume=False) as log:
        answer(log, 3)
    path = tipping / "participants" / "P01" / "plan.toml"
    text = path.read_text()
    path.write_text(text.replace('style = "angry"', 'style = "fearful"', 1))
    with pytest.raises(HighFiveError, match=r"plan .* was changed: its digest is (\w+), expected") as told:
        stored_plan(tipping, "P01")
    digest = str(told.value).partition("its digest is ")[2].partition(",")[0]
    path.write_text(path.read_text().replace(log.plan.digest, digest))
    for session in (1, 2):
        refused = pytest.raises(HighFiveError, match=r"changed after the first run .*: style was angry, is fearful")
        with refused, open_log(tipping, head(session=session), resume=session == 1):
            pass


def test_mixed_versions_are_told_and_each_row_says_its_own(tipping: Path) -> None:
    with open_log(tipping, head(software="1.0"), resume=False) as log:
        answer(log, 3)
    with open_log(tipping, head(software="1.1"), resume=True) as log:
        assert [line for line in log.told if "begun with 1.0, now it is 1.1" in line]
        answer(log, 1)
    assert [row.software for row in read_session(tipping, "P01", 1).rows] == ["1.0"] * 3 + ["1.1"]


def test_two_runs_at_once_on_one_folder_are_refused(tipping: Path) -> None:
    refused = pytest.raises(HighFiveError, match="another run is writing")
    with open_log(tipping, head(), resume=False), refused, open_log(tipping, head("P02"), resume=False):
        pass
    with open_log(tipping, head("P02"), resume=False) as log:
        assert answer(log, 1) == 1


def test_the_lock_of_a_dead_process_is_taken_over(tipping: Path) -> None:
    code = "import fcntl, os, sys, time; fcntl.flock(os.open(sys.argv[1], 0), fcntl.LOCK_EX); print(flush=True); "
    waiting = [sys.executable, "-c", f"{code}time.sleep(600)", str(tipping)]
    with subprocess.Popen(waiting, stdout=subprocess.PIPE) as other:
        assert other.stdout is not None and other.stdout.readline()
        with pytest.raises(HighFiveError, match="another run"), open_log(tipping, head(), resume=False):
            pass
        other.kill()
        other.wait()
        with open_log(tipping, head(), resume=False) as log:
            assert answer(log, 1) == 1
    descriptor = os.open(tipping, os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)  # and given back
    os.close(descriptor)


@pytest.mark.slow
def test_wherever_the_last_line_is_torn_no_row_before_is_lost(tipping: Path) -> None:
    with open_log(tipping, head(), resume=False) as log:
        answer(log, 4)
    path = log_path(tipping)
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    start = len(whole) - len(lines[-1])
    for cut in sorted({start, start + 1, *range(start, len(whole), 37), len(whole) - 1}):
        for rest in (b"", b"\x00" * 40, b"\x00\n"):
            path.write_bytes(whole[:cut] + rest)
            with open_log(tipping, head(), resume=True) as log:
                assert len(log.content.finished) == 3
                # What was begun, and is torn, is asked again, and marked.
                assert sorted(log.content.marked or {}) == [4]
            torn = sorted(path.parent.glob("*.torn-*"))
            assert [file.read_bytes() for file in torn] == (
                [whole[start:cut] + rest] if whole[start:cut] + rest else []
            )
            assert read_log(path.read_bytes(), "log").finished == log.content.finished
            for file in torn:
                file.unlink()


def test_a_log_torn_in_its_very_first_line_can_be_started(tipping: Path) -> None:
    path = log_path(tipping)
    path.parent.mkdir()
    path.write_bytes(b'{"kind": "run", "consent": "1"')
    with open_log(tipping, head(), resume=False) as log:
        assert answer(log, 1) == 1
    assert (path.parent / "trials.jsonl.torn-1").read_bytes() == b'{"kind": "run", "consent": "1"'


def test_damage_before_the_last_line_is_told_and_nothing_is_cut(tipping: Path) -> None:
    with open_log(tipping, head(), resume=False) as log:
        answer(log, 3)
    path = log_path(tipping)
    lines = path.read_bytes().splitlines(keepends=True)
    for wrong, message in ((b"{\n", "line 3: damaged"), (b'{"kind": "x"}\n', "line 3: kind is 'x'")):
        content = b"".join([*lines[:2], wrong, *lines[3:]])
        path.write_bytes(content)
        with pytest.raises(HighFiveError, match=message), open_log(tipping, head(), resume=True):
            pass
        assert path.read_bytes() == content


def test_whatever_line_is_missing_is_noticed(tipping: Path) -> None:
    """But for the last one, which looks as if it had never been written, and a start between two blocks."""
    with open_log(tipping, head(), resume=False) as log:
        answer(log, 4)
        log.begin()
    with open_log(tipping, head(), resume=True) as log:
        answer(log, 3)
    path = log_path(tipping)
    lines = path.read_bytes().splitlines(keepends=True)
    assert [json.loads(line)["kind"] for line in lines].count("mark") == 1
    for number in range(len(lines) - 1):
        path.write_bytes(b"".join(lines[:number] + lines[number + 1 :]))
        with pytest.raises(HighFiveError, match=r"trials\.jsonl, line \d+: .* is missing; take the log from a backup"):
            read_session(tipping, "P01", 1)
    path.write_bytes(re.sub(rb'"answer": ?"\w+"(, "key")', rb'"answer": "glad"\1', b"".join(lines), count=1))
    with pytest.raises(
        HighFiveError, match=r"trials\.jsonl, line \d+: answer is 'glad', expected neutral, fearful, angry"
    ):
        read_session(tipping, "P01", 1)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            rb'"participant": ?"P01", "session"',
            b'"participant": "P02", "session"',
            "participant is 'P02', the plan has",
        ),
        (rb'"condition": ?"interactive"', b'"condition": "own_replay"', "condition is 'own_replay', the plan has"),
        (rb'"expected": ?"\w+"', b'"expected": "none"', "expected is 'none', the plan has"),
        (rb'"session": ?1', b'"session": 2', "is of session 2; a copy counts its trials twice"),
    ],
)
def test_a_row_that_its_own_plan_does_not_have_is_damage(tipping: Path, old: bytes, new: bytes, says: str) -> None:
    with open_log(tipping, head(), resume=False) as log:
        answer(log, 2)
    path = log_path(tipping)
    lines = path.read_bytes().splitlines(keepends=True)
    changed = re.sub(old, new, lines[4], count=1)
    assert changed != lines[4]
    path.write_bytes(b"".join((*lines[:4], changed)))
    with pytest.raises(HighFiveError, match=says):
        read_session(tipping, "P01", 1)


def test_copies_of_a_session_are_refused_and_not_counted_twice(tipping: Path) -> None:
    with open_log(tipping, head(), resume=False) as log:
        answer(log, 2)
    folder = log_path(tipping).parent
    for copy, says in (
        (folder.with_name("session-1 copy"), "is no session's folder"),
        (folder.with_name("session-2"), "is of session 1; a copy counts"),
        (folder.parents[1] / "P02" / "session-1", "is of P01, in the folder of P02"),
    ):
        shutil.copytree(folder, copy)
        with pytest.raises(HighFiveError, match=says):
            study_rows(tipping)
        shutil.rmtree(copy)
    assert len(study_rows(tipping).rows) == 2


def test_a_full_disk_is_told_and_what_was_written_stays_whole(tipping: Path) -> None:
    with open_log(tipping, head(), resume=False) as log:
        answer(log, 3)
        log.begin()
        before = log_path(tipping).read_bytes()
        with files_no_larger_than(len(before) + 100), pytest.raises(HighFiveError, match="not on the disk"):
            log.finish(Outcome())
        assert log_path(tipping).read_bytes() == before
        log.finish(Outcome())  # there is room again
    assert len(read_session(tipping, "P01", 1).rows) == 4


def test_what_cannot_be_is_no_row(tipping: Path) -> None:
    with open_log(tipping, head(), resume=False) as log:
        with pytest.raises(HighFiveError, match="no trial has begun"):
            log.finish(Outcome())
        log.begin()
        with pytest.raises(HighFiveError, match="is not over"):
            log.begin()
        for wrong, message in (
            (Outcome(answer="glad"), "answer 'glad', expected neutral, fearful, angry"),
            (Outcome(certainty=1.5), "certainty is 1.5, expected 0 to 1"),
            (Outcome(weights={"sad": 1.0}), "the plan has"),
            (Outcome(rt_s=float("nan")), "cannot be written"),
            (Outcome(frame="7"), "frame is '7'"),  # pyright: ignore[reportArgumentType]
        ):
            with pytest.raises(HighFiveError, match=message):
                log.finish(wrong)
        log.finish(Outcome(answer="angry"))
    assert len(read_session(tipping, "P01", 1).rows) == 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda lines: [*lines, lines[-1]], "is there twice"),
        (
            lambda lines: [*lines[:2], re.sub(rb'"peak_speed": ?[^,}]+', b'"peak_speed": NaN', lines[2]), *lines[3:]],
            "damaged",
        ),
        (
            lambda lines: [*lines[:2], re.sub(rb'"peak_speed": ?[^,}]+', b'"peak_speed": 1e999', lines[2]), *lines[3:]],
            "damaged",
        ),
    ],
)
def test_a_row_twice_and_numbers_that_are_none_are_damage(
    tipping: Path, change: Callable[[list[bytes]], list[bytes]], says: str
) -> None:
    with open_log(tipping, head(), resume=False) as log:
        for _ in range(2):
            log.begin()
            log.finish(Outcome(answer="angry", key="2", rt_s=0.25, peak_speed=2.5))
    path = log_path(tipping)
    assert b"peak_speed" in path.read_bytes()
    path.write_bytes(b"\n".join(change(path.read_bytes().splitlines())) + b"\n")
    with pytest.raises(HighFiveError, match=says):
        read_session(tipping, "P01", 1)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("rt_s", -5.0, "rt_s is -5.0, expected 0 or more"),
        ("certainty", 7.5, "certainty is 7.5, expected 0 to 1"),
        ("key", "q", "key is 'q', the plan has"),
        ("answer_ns", 5, "answer_ns is 5, before it was asked"),
    ],
)
def test_what_no_answer_can_be_is_damage(tipping: Path, name: str, value: object, says: str) -> None:
    with open_log(tipping, head(), resume=False) as log:
        answer(log, 2, rt_s=1.0, certainty=0.5, asked_ns=10, answer_ns=20)
    path = log_path(tipping)
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    lines[2][name] = value
    path.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    with pytest.raises(HighFiveError, match=f"line 3: {says}"):
        read_session(tipping, "P01", 1)
