"""Answers and commands typed at the terminal by the experimenter, a line each."""

from __future__ import annotations

import sys
import threading
from queue import Empty, SimpleQueue
from typing import TextIO

from highfive.hil.runtime.console import say_aside
from highfive.hil.view.commands import COMMANDS, Command

HELP = (
    "a key or an answer by itself answers; /go on to the block, /rate NAME VALUE, /done with the sliders, /pause, "
    "/continue, /break this trial off, /note TEXT, /stop the run"
)
_PLAIN = {"/go": "ready", "/done": "done", "/break": "break_off", "/stop": "stop"}


def command_of(line: str) -> Command | None:
    """What a line asks for; None where it means nothing."""
    word, _, rest = line.strip().partition(" ")
    if word in _PLAIN and not rest:
        return Command(_PLAIN[word])
    if word in ("/pause", "/continue") and not rest:
        return Command("pause", word == "/pause")
    if word == "/note":
        return _checked("note", rest)
    if word == "/rate":
        name, _, number = rest.partition(" ")
        try:
            return _checked("rate", {"name": name, "value": float(number)})
        except ValueError:
            return None
    return None if not word or word.startswith(("/", "?")) else _checked("answer", {"key": line.strip()})


class TypedCommands:
    """Reads a terminal from a thread of its own."""

    def __init__(self, stream: TextIO | None = None) -> None:
        """Begins to read; standard input by default."""
        self._lines: SimpleQueue[str] = SimpleQueue()
        self._stream = stream or sys.stdin
        threading.Thread(target=self._read, name="typed", daemon=True).start()
        say_aside(f"type: {HELP}")

    def __call__(self) -> list[Command]:
        """What was typed since the last call; a line that means nothing is told."""
        found: list[Command] = []
        while True:
            try:
                line = self._lines.get_nowait()
            except Empty:
                return found
            command = command_of(line)
            if command is not None:
                found.append(command)
            elif line.strip():
                say_aside(HELP if line.strip() == "?" else f"{line.strip()!r} means nothing: {HELP}")

    def _read(self) -> None:
        for line in self._stream:
            self._lines.put(line)


def _checked(name: str, value: object) -> Command | None:
    check = COMMANDS[name]
    found = None if check is None else check(value)
    return None if found is None else Command(name, found)
