"""How the cores are used: one BLAS thread a process, and several processes for work that splits."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import cache
from multiprocessing import connection, get_context, parent_process
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import TypeVar

from threadpoolctl import threadpool_limits

Job = TypeVar("Job")
Result = TypeVar("Result")


SWITCH_S = 5e-4
"""How long a thread that draws or computes may keep the others waiting, s; Python's own 5 ms is most of a frame."""


@contextmanager
def quick_switching() -> Iterator[None]:
    """Threads take turns every :data:`SWITCH_S` meanwhile: what goes by frames and what measures it both say so."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_S)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


@cache
def use_one_blas_thread() -> None:
    """From now on this process's BLAS works in the calling thread alone.

    The matrices of a tick are small: a second thread only waits for the first. With every core busy, a frame of the
    tracker took 30 ms with two threads and 1 ms with one.
    """
    # Limits reach only libraries that are loaded: load the two that NumPy and SciPy bring.
    import scipy.linalg  # noqa: F401, PLC0415

    threadpool_limits(1, user_api="blas")


def parallel_map(
    function: Callable[[Job], Result], jobs: Sequence[Job], progress: Callable[[int], Callable[[], None]]
) -> Iterator[Result]:
    """Results in order of the jobs, which a process a core works off. Whoever leaves early, by Ctrl-C too, ends them
    in what they do.

    Args:
        function: a function of a module, not a closure, nor of the script that runs.
        jobs: arguments, one a call.
        progress: called with the number of jobs; what comes back is called after each.
    """
    advance = progress(len(jobs))
    workers = min(os.cpu_count() or 1, 8, len(jobs))
    if len(jobs) < 4:  # not worth the start of a process
        for job in jobs:
            yield function(job)
            advance()
        return
    # Spawned, not forked: JAX may run threads in this process.
    context = get_context("spawn")
    over, end = context.Pipe(duplex=False)
    with (
        over,
        end,
        TemporaryDirectory(ignore_cleanup_errors=True) as scratch,
        ProcessPoolExecutor(workers, mp_context=context, initializer=_begin_worker, initargs=(over, scratch)) as pool,
    ):
        try:
            with interrupts_held(), _script_hidden():
                results = pool.map(function, jobs)
            for result in results:
                yield result
                advance()
        except BaseException:
            end.close()  # leaving alone would wait for every job, and cancelling for those that have begun
            pool.shutdown(cancel_futures=True)
            raise


@contextmanager
def _script_hidden() -> Iterator[None]:
    """Processes started in here do not run the user's script again, which need not guard itself with ``__name__``."""
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script


def _begin_worker(over: connection.Connection, scratch: str) -> None:
    use_one_blas_thread()
    tempfile.tempdir = scratch  # a worker that is ended in a job leaves its temporary files to its parent
    threading.Thread(target=_end_with_parent, args=(over,), daemon=True).start()


def _end_with_parent(over: connection.Connection) -> None:
    """A parent that was killed tells its workers nothing: they would wait for their next job for good."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel, over])
        os._exit(1)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Ctrl-C is answered when this is left. Processes started in here never see it: only their parent answers it."""
    held: list[int] = []
    # A blocked signal stays blocked in a new process. Here it does not help: another thread takes it for all.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    here = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGINT, lambda number, frame: held.append(number)) if here else None
    try:
        yield
    finally:
        if here:
            signal.signal(signal.SIGINT, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    if held:
        raise KeyboardInterrupt
