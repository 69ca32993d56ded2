"""The address that a command with a live page prints."""

import re
import subprocess


def page_address(process: subprocess.Popen[str]) -> tuple[str, list[str]]:
    """The address, and the lines of standard error up to it, of a command that was just started."""
    assert process.stderr is not None
    said: list[str] = []
    for line in process.stderr:
        said.append(line)
        if found := re.search(r"http://\S+", line):
            return found[0], said
    raise AssertionError("".join(said))
