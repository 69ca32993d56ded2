"""Whether the machine stood still: a process of its own that does nothing but sleep, and says how late it woke."""

import select
import subprocess
import sys
import time
from types import TracebackType
from typing import ClassVar

NAP_S = 0.002
STILL_S = 0.04
"""s; an arm whose servos, or whose host, are silent for not much longer is stopped by its own rules."""
HOPELESS_S = 0.08
"""s; the servos' watchdogs wait so long: after a longer standstill nothing that goes by the clock can be judged."""
SILENT = (
    "not answered for",
    ": no answer; nothing is switched on",
    ": no answer at ",
    "the loop paused for",
    "commands in a row were late",
    "its watchdog heard nothing",
    "the watchdog stopped it",
)
"""What those rules, and the look at the servos before the start, say then."""


class StallWatch:
    """Watches while it is open. One process watches for all that are opened after each other: it costs a start."""

    process: ClassVar[subprocess.Popen[str] | None] = None

    def __enter__(self) -> "StallWatch":
        """Begins."""
        if StallWatch.process is None or StallWatch.process.poll() is not None:
            StallWatch.process = subprocess.Popen(
                [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
        self.longest()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        """Ends."""

    def longest(self) -> float:
        """The longest standstill since it began, or since it was asked, s."""
        process = StallWatch.process
        assert process is not None and process.stdin is not None and process.stdout is not None
        process.stdin.write("\n")
        process.stdin.flush()
        return float(process.stdout.readline())


def main() -> None:
    """Sleeps; says the longest standstill to whoever asks, until nobody is there any more."""
    longest, last = 0.0, time.monotonic()
    while True:
        if select.select([sys.stdin], [], [], 0)[0]:
            if not sys.stdin.readline():
                return
            longest = max(longest, time.monotonic() - last - NAP_S)
            print(longest, flush=True)
            longest, last = 0.0, time.monotonic()
        time.sleep(NAP_S)
        longest, last = max(longest, time.monotonic() - last - NAP_S), time.monotonic()


if __name__ == "__main__":
    main()
