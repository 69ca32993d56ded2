"""``highfive demo``: high fives on a page in the browser at once, beside the session that is played meanwhile."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from highfive.hil.runtime.console import say_aside
from highfive.hil.runtime.folders import results_folder

_VIEW = [sys.executable, "-m", "highfive.hil.cli.main", "view"]


@contextmanager
def page_beside(folder: Path, overwrite: bool, page: bool) -> Iterator[None]:
    """Shows the high fives that come along while a session is played into ``folder``, and then until Ctrl-C.

    In a process of its own: a session compiles at first, and a page that it served would halt meanwhile.

    Args:
        folder: of the session's results.
        overwrite: let it hold something.
        page: whether the page is opened; else its command is named.

    Raises:
        HighFiveError: the folder holds something already or cannot be written.
    """
    with results_folder(folder, overwrite):  # before anything is opened
        pass
    say_aside("high fives are played and filmed; the first time after installing it compiles for minutes before")
    if not page:
        say_aside("meanwhile high fives move in the browser with: highfive view")
        yield
        say_aside(f"see them move, in the browser: highfive view {folder}")
        return
    with subprocess.Popen(_VIEW, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as shown:
        relay = threading.Thread(target=_say_on, args=(shown,), daemon=True)
        relay.start()
        try:
            yield
            if shown.poll() is None:
                say_aside(f"the page goes on until it is ended there, or Ctrl-C; the session: highfive view {folder}")
                with suppress(KeyboardInterrupt):
                    shown.wait()
        finally:
            shown.terminate()
            relay.join()


def _say_on(shown: subprocess.Popen[str]) -> None:
    """What the page's process says, above the progress bars of this one."""
    assert shown.stderr is not None
    for line in shown.stderr:
        if line.strip() != "interrupted":  # Ctrl-C reaches both: one says so
            say_aside(line.rstrip())
