"""The line to ``highfive rig follow``: a JSON object out, one in."""

from __future__ import annotations

import json
import logging
import subprocess
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

logger = logging.getLogger(__name__)

END_S = 60.0
"""So long the arm may take to its rest, s."""


class ArmStopped(ConnectionError):
    """The arm does not follow any more, or never did."""


class ArmLine:
    """The process that drives the arm. It ends with this one."""

    def __init__(self, command: Sequence[str]) -> None:
        """Returns once the arm follows; the first time, something is compiled for a minute.

        Raises:
            ArmStopped: it does not.
        """
        self._said = ""
        try:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
            )
        except OSError as error:
            raise ArmStopped(f"{command[0]} cannot be run: {error.strerror or error}; pip install high-five") from None
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()
        self.first = self._answer()

    @property
    def open(self) -> bool:
        """The process runs."""
        return self._process.poll() is None

    def ask(self, **request: Any) -> dict[str, Any]:
        """The answer to a line.

        Raises:
            ArmStopped: the arm was stopped.
            ValueError: it did not understand; nothing has changed.
        """
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # the answer says why
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        return self._answer()

    def close(self) -> None:
        """Has the arm go back to where it rests, and waits for that."""
        with suppress(ArmStopped, OSError, ValueError):
            self.ask(end=True)
        with suppress(OSError):
            assert self._process.stdin is not None
            self._process.stdin.close()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:  # its driver holds the arm where it is
            self._process.kill()
            self._process.wait()
        self._listener.join(1.0)

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        answer = json.loads(line) if line else {}
        if not line or "stopped" in answer:
            self._process.wait(END_S)
            self._listener.join(1.0)
            raise ArmStopped(answer.get("stopped") or self._said or "highfive rig follow ended")
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer

    def _listen(self) -> None:
        """What the command says to people."""
        assert self._process.stderr is not None
        for line in self._process.stderr:
            if line.strip():
                self._said = line.strip().removeprefix("error: ")
                logger.info(self._said)


def joints_of(command: Sequence[str]) -> list[str]:
    """Names of an arm's joints, from ``highfive rig joints --json``.

    Raises:
        ArmStopped: there is no such arm, or no such command.
    """
    try:
        run = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise ArmStopped(f"{command[0]} cannot be run: {error.strerror or error}; pip install high-five") from None
    if run.returncode:
        raise ArmStopped((run.stderr.strip().splitlines() or ["highfive rig joints ended"])[-1].removeprefix("error: "))
    return [joint["name"] for joint in json.loads(run.stdout)["joints"]]
