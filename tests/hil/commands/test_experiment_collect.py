"""``highfive experiment collect``: two people who are served, in virtual time and over sockets."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from command_line import failing
from live_commands import ended, serving, start, stop
from numpy.testing import assert_allclose
from virtual_system import VirtualSystem

from highfive.hil.commands.experiment_collect import CollectOptions, collect, led
from highfive.hil.commands.simulate_options import PageOptions
from highfive.hil.commands.simulated_participant import PageInProcess, participant_on_page
from highfive.hil.datasets.collection import Collection, CollectionFolder, takes_of
from highfive.hil.datasets.training_data import load_trials
from highfive.hil.experiments.observer import Observer, SimulatedParticipant
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.sim.people.actors import simulate_pair
from highfive.hil.sim.people.capture import Defects, record_pair, trial_seed
from highfive.hil.trials.live_partner import live_source
from highfive.hil.trials.two_people import TwoPeople
from highfive.mocap_bridge.files.c3d import read_c3d, write_c3d
from highfive.mocap_bridge.files.recording import Recording
from highfive.mocap_bridge.files.trial_table import read_table
from highfive.mocap_bridge.sources.live import LiveSource
from highfive.model.errors import HighFiveError

ADDRESS = "vicon://lab"
ASKED = Collection(("neutral", "angry"), ("B2", "C1"), 2, 1, 3, "human", "avatar", simulated=True)

fails = failing("experiment", "collect")


def no_bar(label: str, total: int) -> Any:
    return lambda note="", done=None: None


def pair(cell: str = "B2") -> Recording:
    rng = trial_seed(2, "neutral", cell, 0)
    return record_pair(simulate_pair("neutral", cell, 0, rng), Defects(), rng)


@pytest.fixture
def clock() -> Iterator[VirtualClock]:
    with VirtualClock() as clock:
        yield clock


def someone() -> SimulatedParticipant:
    """Presses *Go on* whenever she may."""
    return SimulatedParticipant(Observer(), "both")


def led_by(
    clock: VirtualClock, system: VirtualSystem, folder: Path, asked: Collection = ASKED, **options: Any
) -> dict[str, Any]:
    """The run in virtual time, from the wire to the folder."""
    folder.mkdir(exist_ok=True)
    with ExitStack() as stack:

        def source(who: str) -> LiveSource:
            return stack.enter_context(closing(live_source(ADDRESS, who, system.wiring)))

        people = TwoPeople((source("human"), source("avatar")), ("human", "avatar"), clock)
        chosen = CollectOptions(folder, ADDRESS, asked, seconds=5.0, **options)
        return led(chosen, CollectionFolder(folder, asked), people, PageInProcess(someone(), clock), no_bar, clock)


@pytest.mark.slow
def test_what_was_sent_of_both_is_what_is_recorded(clock: VirtualClock, tmp_path: Path) -> None:
    """Every frame of the data folder's takes is a frame of the recording that is served, in its order."""
    served = pair()
    result = led_by(clock, VirtualSystem(clock, served), tmp_path / "data", any_cell=True)
    assert (result["good"], result["left"]) == (8, 0)
    rows = read_table(tmp_path / "data")
    assert [(row.emotion, row.cell, row.repetition) for row in rows] == [
        (take.emotion, take.cell, take.repetition) for take in takes_of(ASKED)
    ]
    take = read_c3d(tmp_path / "data" / rows[0].file)
    assert set(take.names) == set(served.names) and take.rate_hz == served.rate_hz
    columns = [served.names.index(name) for name in take.names]
    points = served.points[:, columns]
    begins = next(
        n
        for n in range(len(points))
        if all(abs(points[n][take.valid[0]] - take.points[0][take.valid[0]]).max(1) < 1e-5)
    )
    for row in range(0, len(take), 7):
        n = (begins + row) % len(points)
        both = take.valid[row] & served.valid[n][columns]
        assert_allclose(take.points[row][both], points[n][both], atol=1e-5)
        assert both.sum() > 0.8 * len(columns)


@pytest.mark.slow
def test_hands_that_meet_elsewhere_are_asked_again_and_kept_apart(clock: VirtualClock, tmp_path: Path) -> None:
    result = led_by(clock, VirtualSystem(clock, pair("B2")), tmp_path / "data")
    left = CollectionFolder(tmp_path / "data", ASKED).left
    assert result["good"] == 4 and {take.cell for take in left} == {"C1"} and len(left) == 4
    rejected = CollectionFolder(tmp_path / "data", ASKED).rejected
    elsewhere = [row for row in rejected if "_C1_" in row["file"]]
    assert len(elsewhere) == 4 * 6  # thrice, and thrice again
    assert sum("hands met in B2" in row["why"] for row in elsewhere) > 12  # of some the loop cuts the beginning off
    assert result["bad"] == len(rejected) and all((tmp_path / "data" / row["file"]).is_file() for row in rejected)


@pytest.mark.slow
def test_a_source_that_dies_ends_it_and_the_same_command_goes_on(clock: VirtualClock, tmp_path: Path) -> None:
    system = VirtualSystem(clock, pair())
    at = clock.now() + 20_000_000_000
    clock.start("switch", lambda: (clock.wait_until(at), system.hang_up()))
    with pytest.raises(HighFiveError, match=r"nothing has come of .* for 1 s .*the same command goes on"):
        led_by(clock, system, tmp_path / "data", any_cell=True)
    done = len(read_table(tmp_path / "data"))
    assert 0 < done < 8
    system.answer()
    result = led_by(clock, system, tmp_path / "data", any_cell=True)
    assert result["left"] == 0 and result["recorded"] - result["bad"] == 8 - done
    assert len({row.file for row in read_table(tmp_path / "data")}) == 8


def test_one_of_two_who_is_not_sent_is_said(clock: VirtualClock, tmp_path: Path) -> None:
    wiring = VirtualSystem(clock, pair()).wiring
    with closing(live_source(ADDRESS, "nobody", wiring)) as source, pytest.raises(HighFiveError, match="nobody"):
        TwoPeople((source, source), ("nobody", "nobody"), clock)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--source", "file.c3d"], "people are recorded live"),
        (["--source", "headset"], "sees one person"),
        (["--source", "webcam"], "sees one person"),
        (["--source", "vicon://x", "--human", "avatar"], "both people are called avatar"),
        (["--source", "vicon://x", "--cell", "D4"], "unknown cell 'D4'"),
        (["--source", "vicon://x", "--repetitions", "1"], "leave nothing to learn from"),
        (["--source", "vicon://x", "--emotion", "Angry!"], "expected a word of small letters"),
    ],
)
def test_what_is_wrong_is_one_line(words: list[str], says: str, fails, tmp_path: Path) -> None:
    assert says in fails("--out", tmp_path / "data", "--no-open", *words)
    assert not (tmp_path / "data").exists()


@pytest.mark.slow(50)
def test_two_served_people_fill_a_folder_that_a_model_is_trained_on(tmp_path: Path) -> None:
    """Over sockets, by page: killed in between, gone on with, and read by what training reads."""
    write_c3d(tmp_path / "pair.c3d", pair())
    server, address, _ = serving("vicon", tmp_path / "pair.c3d", "--loop", "--port", 0)
    asked = replace(ASKED, cells=("B2",), repetitions=3)
    options = CollectOptions(
        tmp_path / "data", address, asked, seconds=5.0, between=0.5, view=PageOptions(open_browser=False)
    )
    try:
        code = (
            "from pathlib import Path; import test_experiment_collect as t; "
            f"t.collect_here(Path({str(tmp_path / 'data')!r}), {address!r})"
        )
        paths = os.pathsep.join([str(Path(__file__).parent), *sys.path])
        process = subprocess.Popen([sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": paths})
        while process.poll() is None and not (tmp_path / "data" / "trials.csv").is_file():
            with suppress(subprocess.TimeoutExpired):
                process.wait(0.05)
        process.send_signal(signal.SIGKILL)
        process.wait()
        before = len(read_table(tmp_path / "data"))
        with ExitStack() as stack:
            opened = lambda page: stack.enter_context(participant_on_page(someone(), page.address))  # noqa: E731
            result = collect(options, no_bar, opened=opened)
    finally:
        stop(server)
    assert before >= 1 and result["left"] == 0 and result["good"] == 6
    pairs = load_trials(tmp_path / "data", say=lambda line: None)
    assert len(pairs) == 6 and {one.trial.emotion for one in pairs} == {"neutral", "angry"}
    assert sum(one.trial.test for one in pairs) == 2


def collect_here(folder: Path, address: str) -> None:
    """In a process of its own."""
    asked = replace(ASKED, cells=("B2",), repetitions=3)
    options = CollectOptions(folder, address, asked, seconds=5.0, between=0.5, view=PageOptions(open_browser=False))
    with ExitStack() as stack:
        collect(options, no_bar, opened=lambda page: stack.enter_context(participant_on_page(someone(), page.address)))


@pytest.mark.slow
def test_nothing_listens(tmp_path: Path) -> None:
    words = ("experiment", "collect", "--source", "vicon://127.0.0.1:9", "--out", tmp_path / "data", "--no-open")
    code, _, err = ended(start(*words))
    assert code == 2 and "nothing listens" in err
    assert not (tmp_path / "data").exists()
