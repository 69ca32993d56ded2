"""A run: who is asked what, what the experimenter asks for, and what a crash leaves."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.experiments import head, study

from highfive.hil.commands.simulated_participant import PageInProcess
from highfive.hil.experiments.conduct import Conducted, conduct
from highfive.hil.experiments.desk import Desk
from highfive.hil.experiments.observer import Observer, Perception, SimulatedParticipant
from highfive.hil.experiments.stage import Asked, EmptyStage, Played, RunFailedError, TrialBrokenOffError
from highfive.hil.experiments.study import study_protocol
from highfive.hil.experiments.trial_log import TrialLog, open_log, read_session
from highfive.hil.experiments.trial_row import TrialRow
from highfive.hil.experiments.words import PAGE
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.view.commands import Command
from highfive.model.errors import HighFiveError

SURE = Observer(interactive=Perception(right=1.0), replay=Perception(right=1.0))


class Stage(EmptyStage):
    """Does something of its own in the nth trial of a run."""

    def __init__(self, clock: VirtualClock, happens: dict[int, Callable[[], None]]) -> None:
        super().__init__(clock)
        self.happens, self.count = happens, 0
        self.asked: list[Asked] = []

    def play(self, asked: Asked, cue: Callable[[], None]) -> Played:
        self.count += 1
        self.asked.append(asked)
        if self.count in self.happens:
            cue()
            self.happens[self.count]()
        return super().play(asked, cue)


def fails(error: BaseException) -> Callable[[], None]:
    def happen() -> None:
        raise error

    return happen


class ToldPage(PageInProcess):
    """Keeps what it was told."""

    def __init__(self, participant: SimulatedParticipant, clock: VirtualClock) -> None:
        super().__init__(participant, clock)
        self.told: list[tuple[str, object]] = []

    def tell(self, kind: str, **fields: Any) -> None:
        self.told.append((kind, fields.get("phase") or fields.get("message")))
        super().tell(kind, **fields)


class Run:
    """A participant's run with a simulated participant, in virtual time."""

    def __init__(
        self, folder: Path, observer: Observer = SURE, resume: bool = False,
        happens: dict[int, Callable[[], None]] | None = None, typed: Callable[[int], Sequence[Command]] | None = None,
    ) -> None:  # fmt: skip
        self.folder, self.observer, self.resume = folder, observer, resume
        self.happens, self.typed = happens or {}, typed
        self.stage: Stage | None = None
        self.page: ToldPage | None = None

    @contextmanager
    def log(self, clock: VirtualClock) -> Iterator[TrialLog]:
        with open_log(self.folder, head(), self.resume, clock) as log:
            yield log

    def __call__(self) -> Conducted:
        with VirtualClock() as clock, self.log(clock) as log:
            self.stage = stage = Stage(clock, self.happens)

            def asked() -> Sequence[Command]:
                return () if self.typed is None else self.typed(stage.count)

            self.page = ToldPage(SimulatedParticipant(self.observer, "P01"), clock)
            desk = Desk(self.page, clock, asked, 50_000_000)
            return conduct(self.folder, log, study_protocol(self.folder), desk, stage, clock)

    def rows(self) -> list[TrialRow]:
        return read_session(self.folder, "P01", 1).rows


@pytest.fixture
def small(tmp_path: Path) -> Path:
    return study(tmp_path)


def once(commands: dict[int, Command]) -> Callable[[int], Sequence[Command]]:
    """Types each once, as soon as that trial was begun."""
    left = dict(commands)
    return lambda count: [left.pop(count)] if count in left else []


def test_a_plan_is_asked_in_its_order_and_every_answer_is_in_its_row(small: Path) -> None:
    run = Run(small)
    done = run()
    rows = run.rows()
    plan = [trial.name for trial in read_plan(small)]
    assert [row.trial for row in rows] == plan and (done.asked, done.left, done.why) == (len(plan), 0, "")
    assert all(row.answer == row.expected and not row.excluded_why and not row.broken_off for row in rows)
    assert all(row.simulated for row in rows)
    for row in rows:
        assert row.cue_ns and row.ended_ns and row.asked_ns and row.answer_ns
        assert row.cue_ns < row.ended_ns <= row.asked_ns < row.answer_ns
        assert row.rt_s == pytest.approx(1e-9 * (row.answer_ns - row.asked_ns), abs=1e-6)
        assert row.contact_ns and row.cue_ns < row.contact_ns < row.ended_ns  # of a replay, as it is shown
        assert row.motion_s == pytest.approx(1e-9 * (row.ended_ns - row.cue_ns))
        assert row.certainty is not None and 0.0 <= row.certainty <= 1.0


@pytest.mark.parametrize("stops", [False, True])
def test_pages_and_headsets_are_told_the_end_last(small: Path, stops: bool) -> None:
    run = Run(small, typed=once({3: Command("stop", None)}) if stops else None)
    assert bool(run().left) is stops and run.page is not None
    assert run.page.told[-2:] == [("participant", "over"), ("over", PAGE["ends" if stops else "finished"])]
    assert [kind for kind, _ in run.page.told].count("over") == 1


def read_plan(folder: Path):
    from highfive.hil.experiments.study import stored_plan  # noqa: PLC0415

    return stored_plan(folder, "P01").trials


def test_a_replay_shows_the_trial_that_the_plan_names_as_it_was_asked_then(small: Path) -> None:
    run = Run(small)
    run()
    rows = {row.trial: row for row in run.rows()}
    assert run.stage is not None
    shown = [asked for asked in run.stage.asked if asked.source is not None]
    assert len(shown) == 36
    for asked in shown:
        assert asked.source is not None
        assert asked.source == rows[asked.trial.source] and asked.weights == dict(rows[asked.trial.source].weights)
        assert asked.source.style == asked.trial.style


def test_a_trial_without_an_answer_is_in_the_log_and_does_not_count(small: Path) -> None:
    run = Run(small, replace(SURE, silent=1.0))
    done = run()
    assert done.excluded == done.asked == len(run.rows())
    assert {row.excluded_why for row in run.rows()} == {"no answer within 15 s"}


def test_an_answer_that_takes_too_long_is_no_answer(small: Path) -> None:
    run = Run(small, replace(SURE, rt_s=20.0, rt_spread=0.0))
    run()
    assert {row.excluded_why for row in run.rows()} == {"no answer within 15 s"}


def test_the_experimenter_breaks_off_a_trial_notes_it_and_its_replay_is_not_asked(small: Path) -> None:
    run = Run(
        small, typed=once({5: Command("note", "coughed"), 6: Command("break_off")}),
        happens={6: fails(TrialBrokenOffError("broken off by the experimenter"))},
    )  # fmt: skip
    done = run()
    rows = run.rows()
    assert rows[4].notes == "coughed" and rows[5].broken_off and done.broken_off == 1
    assert rows[5].trial not in {row.source_trial for row in rows} and done.asked == len(read_plan(small)) - 1
    assert (done.left, done.sourceless) == (0, 1)


def test_a_stop_in_the_last_trial_leaves_nothing_to_resume(small: Path) -> None:
    last = len(read_plan(small))
    run = Run(small, typed=once({last: Command("stop")}))
    done = run()
    assert (done.why, done.left, done.sourceless) == ("stopped by the experimenter", 0, 0)
    assert run.page is not None and run.page.told[-1] == ("over", PAGE["finished"])


def test_breaking_off_while_the_answer_is_asked_breaks_that_trial_off(small: Path) -> None:
    typed = once({4: Command("break_off")})
    run = Run(small, replace(SURE, rt_s=5.0), typed=typed)
    run()
    assert [row.trial for row in run.rows() if row.broken_off] == [run.rows()[3].trial]


def test_stop_ends_the_run_and_the_block_begins_again(small: Path) -> None:
    run = Run(small, typed=once({7: Command("stop")}))
    done = run()
    assert done.why == "stopped by the experimenter" and done.left > 60
    again = Run(small, resume=True)
    assert again().left == 0
    check_nothing_is_lost_or_asked_twice(small)
    with pytest.raises(HighFiveError, match="--resume"):
        Run(small)()


def test_a_source_that_dies_ends_the_run_with_the_trial_in_the_log(small: Path) -> None:
    gone = RunFailedError("nothing has come for 2 s (silent)")
    run = Run(small, happens={9: fails(gone)})
    with pytest.raises(RunFailedError):
        run()
    assert run.rows()[-1].broken_off == "nothing has come for 2 s (silent)"
    assert Run(small, resume=True)().left == 0
    check_nothing_is_lost_or_asked_twice(small)


@pytest.mark.parametrize("place", [1, 4, 16, 17, 40, 87])
def test_ctrl_c_is_in_the_log_and_a_resumed_run_asks_what_is_left(small: Path, place: int) -> None:
    with pytest.raises(KeyboardInterrupt):
        Run(small, happens={place: fails(KeyboardInterrupt())})()
    assert Run(small, resume=True)().left == 0
    check_nothing_is_lost_or_asked_twice(small)


def check_nothing_is_lost_or_asked_twice(folder: Path) -> None:
    content = read_session(folder, "P01", 1)
    standing = Counter(row.trial for row in content.standing)
    assert set(standing) == {trial.name for trial in read_plan(folder)} and set(standing.values()) == {1}


def test_a_pause_waits_before_the_next_trial_and_a_long_one_begins_the_block_again(small: Path) -> None:
    def typed(count: int) -> Sequence[Command]:
        nonlocal looks
        if count != 6:
            return ()
        looks += 1
        return [Command("pause", True)] if looks == 1 else [Command("pause", False)] if looks == 15_000 else ()

    looks = 0
    run = Run(small, typed=typed)
    assert run().left == 0
    marked = [row for row in run.rows() if "a pause of" in row.excluded_why]
    assert len(marked) == 3 and {row.block for row in marked} == {"I1"}
    check_nothing_is_lost_or_asked_twice(small)


def test_an_adaptive_run_shows_what_the_answers_make_the_next_and_its_replay_the_same_again(tmp_path: Path) -> None:
    observer = Observer(interactive=Perception(pse=0.7, jnd=0.08), replay=Perception(pse=0.4, jnd=0.08))
    folder = study(
        tmp_path, "morph",
        {'method = "constant"': 'method = "adaptive"', "levels = [0.0, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0]": "# levels",
         "participants = 16": "participants = 1", "repetitions = 4": "repetitions = 20"},
    )  # fmt: skip
    run = Run(folder, observer)
    run()
    rows = {row.trial: row for row in run.rows()}
    own = [row for row in rows.values() if row.condition == "interactive" and row.style == "adaptive"]
    assert len({row.weights["angry"] for row in own}) > 5
    late = [row.weights["angry"] for row in own[20:]]
    assert sum(0.45 < weight < 0.95 for weight in late) > 0.7 * len(late)  # around her own PSE
    for row in rows.values():
        if row.source_trial:
            assert row.weights == rows[row.source_trial].weights
