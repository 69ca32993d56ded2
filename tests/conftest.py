"""Shared fixtures."""

import atexit
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from jaxtyping import install_import_hook
from kept import kept
from parts import shared_out

# What is compiled is kept: for the other workers, for the commands that tests start, and for the next run. JAX looks at
# where as it is imported.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path(__file__).resolve().parents[1] / ".pytest_cache" / "jax"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")  # hundreds of small ones, too

# A shell that starts the tests in the background has them, and whatever they start, ignore Ctrl-C.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# A law holds however long an example takes, as in the profile that Hypothesis takes in CI.
settings.register_profile("patient", deadline=None)
if "CI" not in os.environ:
    settings.load_profile("patient")

# Of LSL streams this process sees its own, and those of what it starts: other workers have some of the same name.
_LSL = Path(tempfile.mkdtemp(prefix="highfive-lsl-")) / "lsl_api.cfg"
_LSL.write_text(f"[lab]\nSessionID = highfive-{os.getpid()}\n[log]\nlevel = -3\n", encoding="utf-8")
atexit.register(shutil.rmtree, _LSL.parent, ignore_errors=True)
os.environ["LSLAPICFG"] = str(_LSL)

# The shapes that the values at the seams declare are checked while the tests run, from when they are first imported.
CHECKED = [
    "highfive.mocap_bridge.frames",
    "highfive.hil.sim.avatar",
    "highfive.hil.session.reach",
    "highfive.hil.trials.trial_result",
    "highfive.hil.trials.trial",
    "highfive.hil.trials.judging",
]
install_import_hook(CHECKED, "beartype.beartype")

import jax  # noqa: E402

from highfive.hil.runtime.threads import use_one_blas_thread  # noqa: E402
from highfive.mocap_bridge.files.trial_table import read_table, write_table  # noqa: E402

use_one_blas_thread()  # as every session does

# Files in the order of their cost (docs/testing.md), of which the planner, the tracker and the tick of the model are no
# part: tests/compile_ahead.py compiles those. Of the rest each takes a few seconds.
LONGEST = (
    "test_track.py", "test_rig_session.py", "test_simulate.py", "test_responder.py", "test_hierarchy.py",
    "test_stream.py", "test_sparse.py", "test_training.py", "test_fault_schedules.py", "test_kernels.py",
    "test_folders.py", "test_rig_refusals.py", "test_training_data.py", "test_export.py", "test_safety_times.py",
    "test_follow.py", "test_tick.py", "test_session.py", "test_replay.py", "test_calibrate_headset.py",
    "test_arm_loop.py", "test_tracker.py", "test_lost_samples.py", "test_study_rows.py", "test_safety_feed_forward.py",
    "test_play_view.py", "test_report.py", "test_own_body.py", "test_fault_recording.py", "test_restarts.py",
    "test_film.py", "test_lerobot.py", "test_calibrate_event.py", "test_experiment_collect.py", "test_recording.py",
    "test_compiled.py", "test_unseen.py", "test_arms.py", "test_retarget.py",
)  # fmt: skip
RANK = {name: rank for rank, name in enumerate(LONGEST)}

EACH_CASE = frozenset(("test_examples.py", "test_code_blocks.py"))
"""Files whose cases are no variations: each notebook and each page is one of its own."""

# Slow tests that CI runs for every commit, and not one commit in so many: how near palms come, what an arm does beside
# people, a session's end, what is installed, the site, the examples.
EVERY_COMMIT = frozenset((
    "test_contact.py", "test_safety_times.py", "test_session_check.py", "test_rig_session.py",
    "test_fault_schedules.py", "test_own_body.py", "test_session.py", "test_simulate.py", "test_kills.py",
    "test_package.py", "test_site.py", "test_messages.py", "test_code_blocks.py", "test_examples.py",
))  # fmt: skip

USUAL_S = 4.0
"""s that a slow test takes which does not say how long, on average."""

_OF_SEVERAL = pytest.StashKey[set[str]]()


def pytest_itemcollected(item: pytest.Item) -> None:
    """Of the slow cases of one test CI runs the first; the others are part of ``make sweep``."""
    if item.get_closest_marker("slow") is None or item.path.name in EACH_CASE:
        return
    seen = item.config.stash.setdefault(_OF_SEVERAL, set())
    if (name := item.nodeid.partition("[")[0]) in seen:
        item.add_marker("sweep")
    seen.add(name)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--part", metavar="K/N", help="slow tests of every commit, and of the others' files the Kth of N")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """The longest first, so that no worker has one left at the end; slow ones by the seconds in their mark."""
    if part := config.getoption("--part"):
        _keep_part(config, items, *map(int, part.split("/")))
    items.sort(key=lambda item: (-_seconds(item), RANK.get(item.path.name, len(RANK))))


def _keep_part(config: pytest.Config, items: list[pytest.Item], part: int, parts: int) -> None:
    seconds: dict[str, float] = {}
    for item in items:
        if item.path.name not in EVERY_COMMIT:
            name = item.nodeid.partition("::")[0]
            seconds[name] = seconds.get(name, 0.0) + (_seconds(item) or USUAL_S)
    part_of = shared_out(seconds, parts)
    left = [item for item in items if part_of.get(item.nodeid.partition("::")[0], part - 1) != part - 1]
    config.hook.pytest_deselected(items=left)
    items[:] = [item for item in items if item not in set(left)]


def _seconds(item: pytest.Item) -> float:
    mark = item.get_closest_marker("slow")
    return mark.args[0] if mark is not None and mark.args else 0.0


RECORDINGS = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Folder of real recordings; tests that use it carry the mark ``data``."""
    if not RECORDINGS.is_dir():
        pytest.skip("the recordings are not beside this checkout (../shared/data)")
    return RECORDINGS


@pytest.fixture(scope="session")
def captured() -> Path:
    """A folder with angry high fives at all nine cells, one each, of seed 5; not to be written to."""

    def make(folder: Path) -> None:
        words = ["capture", "--emotion", "angry", "--repetitions", "1", "--seed", "5", "--out", str(folder), "--json"]
        done = subprocess.run(
            [sys.executable, "-m", "highfive.hil.cli.main", *words], check=True, stdout=subprocess.PIPE, text=True
        )
        said = json.loads(done.stdout)
        assert said == {"trials": 9, "emotions": ["angry"], "seed": 5, "folder": str(folder), "simulated": True}

    return kept("captured", make)


@pytest.fixture
def to_learn(captured: Path, tmp_path: Path) -> Path:
    """A folder with those of seven cells to learn from and those of two held out."""
    folder = tmp_path / "to_learn"
    folder.mkdir()
    rows = []
    for row in read_table(captured):
        (folder / row.file).symlink_to(captured / row.file)
        rows.append((row.file, row.emotion, row.cell, "1", "test" if row.cell in {"B1", "B3"} else "train"))
    write_table(folder, rows)
    return folder


@pytest.fixture
def hurried() -> Iterator[None]:
    """JAX compiles in a hurry: for trainings, of which compiling is most; afterwards it has to do so again."""
    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)
    jax.clear_caches()
