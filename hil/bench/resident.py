"""How much memory a process has had at the most."""

from __future__ import annotations

from pathlib import Path


def peak_resident(pid: int | str = "self") -> int:
    """Largest resident set since the process began its program, bytes; 0 of one that has ended.

    ``getrusage`` and ``wait4`` begin with what the parent had.

    Raises:
        OSError: there is no such process.
    """
    _, found, rest = Path(f"/proc/{pid}/status").read_text().partition("VmHWM:")
    return 1024 * int(rest.split(maxsplit=1)[0]) if found else 0
