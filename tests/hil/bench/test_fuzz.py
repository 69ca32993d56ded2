"""Every reader takes damaged inputs; and what no reader may do is seen."""

import multiprocessing
import os
import sys
import time
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from highfive.hil.bench.fuzz import FuzzOptions, bench_fuzz
from highfive.hil.bench.fuzz_reader import Seed, drawn
from highfive.hil.bench.fuzz_readers import READERS
from highfive.hil.bench.fuzz_worker import _Worker
from highfive.model.errors import HighFiveError

FEW, MANY = 200, 500


def no_bar(label: str, total: int) -> Any:
    return lambda note="", done=None: None


@pytest.mark.slow
def test_every_reader_gives_a_value_or_a_line() -> None:
    found = bench_fuzz(FuzzOptions(inputs=FEW), no_bar)
    assert found["broken"] == []
    assert found["inputs"] == FEW * len(READERS)


@pytest.mark.slow(40)
def test_every_reader_gives_a_value_or_a_line_many_times() -> None:
    assert bench_fuzz(FuzzOptions(inputs=MANY, first=FEW, seed=1), no_bar)["broken"] == []


@pytest.mark.parametrize("reader", ["npz", "toml", "mcap", "page", "take"])
@pytest.mark.slow
def test_inputs_are_the_same_each_time_and_not_the_sound_ones(reader: str) -> None:
    seeds = READERS[reader]()
    first, again = ([drawn(seeds, reader, 3, n)[1] for n in range(len(seeds) + 60)] for _ in range(2))
    assert first == again
    damaged = first[len(seeds) :]
    assert len({*damaged}) > 50 and sum(one in [seed.content for seed in seeds] for one in damaged) < 15
    assert damaged != [drawn(seeds, reader, 4, n)[1] for n in range(len(seeds), len(seeds) + 60)]


def hang(content: bytes, folder: Path) -> None:
    while True:
        pass


def swallow(content: bytes, folder: Path) -> None:
    while True:
        with suppress(Exception):
            time.sleep(0.0)


def swell(content: bytes, folder: Path) -> None:
    try:
        np.ones(400 << 17)  # 400 MB
    except MemoryError:
        raise HighFiveError("no") from None


def escape(content: bytes, folder: Path) -> None:
    (folder.parent / f"highfive-escaped-{os.getpid()}").write_bytes(content)
    (folder.parent / f"highfive-escaped-{os.getpid()}").unlink()


def stay(content: bytes, folder: Path) -> None:
    (folder / "a").mkdir()
    (folder / "a" / "b").write_bytes(content)
    (folder / "a" / "b").rename(folder / "c")


def start(content: bytes, folder: Path) -> None:
    os.system("true")


def fail(content: bytes, folder: Path) -> None:
    raise KeyError("x")


def warn(content: bytes, folder: Path) -> None:
    warnings.warn("x", stacklevel=1)


def talk(content: bytes, folder: Path) -> None:
    print("x", file=sys.stderr)


def refuse(content: bytes, folder: Path) -> None:
    raise HighFiveError("no such thing; take another")


def say_nothing(content: bytes, folder: Path) -> None:
    raise HighFiveError


CASES = {
    hang: "takes more", swallow: "takes more", swell: "took", escape: "touched", start: "touched", fail: "KeyError",
    warn: "UserWarning", talk: "printed", refuse: "", stay: "", say_nothing: "no line",
}  # fmt: skip


def _judged(folder: Path, said: Any) -> None:
    worker = _Worker(folder)
    worker.warm_up([])
    said.send([worker.wrong(Seed(b"x", read), b"x") for read in CASES])


@pytest.mark.slow(55)
def test_what_no_reader_may_do_is_seen(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    heard, said = context.Pipe(duplex=False)
    process = context.Process(target=_judged, args=(tmp_path, said))
    process.start()
    assert heard.poll(600.0)
    found = heard.recv()
    process.join()
    for (read, expected), wrong in zip(CASES.items(), found, strict=True):
        assert (wrong is None) == (not expected), f"{read.__name__}: {wrong}"
        assert wrong is None or wrong[0].startswith(expected), f"{read.__name__}: {wrong}"


def test_an_unknown_reader_is_refused() -> None:
    with pytest.raises(HighFiveError, match="c3d, mcap"):
        bench_fuzz(FuzzOptions(readers=("x",)), no_bar)
