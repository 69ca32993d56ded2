"""Whether the machine stood still: a process of its own that does nothing but sleep, and says how late it woke."""

import select
import subprocess
import sys
import time
from types import TracebackType

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
    """Watches while it is open."""

    def __enter__(self) -> "StallWatch":
        """Begins."""
        self.process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        """Ends."""
        self.process.kill()
        self.process.communicate()

    def longest(self) -> float:
        """The longest standstill so far, s; it ends with this."""
        said, _ = self.process.communicate("\n")
        return float(said)


def main() -> None:
    """Sleeps until somebody asks."""
    longest, last = 0.0, time.monotonic()
    while not select.select([sys.stdin], [], [], 0)[0]:
        time.sleep(NAP_S)
        longest, last = max(longest, time.monotonic() - last - NAP_S), time.monotonic()
    print(longest)


if __name__ == "__main__":
    main()
