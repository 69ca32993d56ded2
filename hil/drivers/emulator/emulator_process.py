"""An emulator in a process of its own, so that whoever talks to it leaves it its time.

The child is ``python -m highfive.hil.drivers.emulator.emulator_process``. It gets what to do by one JSON object on
its first line of standard input, says the port in one on its first line of output, takes faults from the lines that
follow, acknowledges each once it is in force, and says its summary when its input ends: so it does not outlive its
parent.
"""

from __future__ import annotations

import importlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from types import TracebackType
from typing import Any, TextIO

from highfive.hil.drivers.bus.control_table import baud_index, load_table
from highfive.hil.drivers.bus.packet import LAST_ID
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.bus_faults import parse_faults
from highfive.hil.drivers.emulator.emulated_bus import EmulatedBus
from highfive.hil.drivers.emulator.emulated_servo import EmulatedServo
from highfive.hil.drivers.emulator.emulator import Emulator
from highfive.hil.drivers.emulator.servos_of_rig import build_servos
from highfive.hil.drivers.priority import go_first
from highfive.model.errors import HighFiveError

FACTORY_BAUD = 57_600

_ENDING_S = 10.0
_ENDED = "the emulator has ended; start another one"


@dataclass(frozen=True)
class EmulatorOptions:
    """What is emulated.

    Attributes:
        rig: file of the rig; None for the one that comes with the project.
        servos: in place of a rig, servos as from the factory, each on a joint of its own: ``ID=MODEL``.
        plant: ``package.module:function`` of the function that makes the body, called without arguments; None for an
            inertia a joint. It is imported in the emulator's process.
        faults: as :func:`~highfive.hil.drivers.emulator.bus_faults.parse_fault` reads them; times count from the start.
        link: path of the symbolic link to the port; None for none.
        paced: bytes take their time.
        configured: the servos hold what the rig wants of them; otherwise what they left the factory with.
        baud_rate: of the servos; None for the rig's.
        seed: of what is random in faults.
        astray: (J,) rad, by which each joint is further than its servos say; empty for nothing.
    """

    rig: str | None = None
    servos: tuple[str, ...] = ()
    plant: str | None = None
    faults: tuple[str, ...] = ()
    link: str | None = None
    paced: bool = True
    configured: bool = True
    baud_rate: int | None = None
    seed: int = 0
    astray: tuple[float, ...] = ()


def make_bus(options: EmulatorOptions) -> EmulatedBus:
    """The bus of the options, with their faults.

    Raises:
        HighFiveError: there is no such rig or plant, or a fault is spelt otherwise or of a servo that is not there.
    """
    if options.servos:
        servos, joints = [_servo(text, options.baud_rate or FACTORY_BAUD) for text in options.servos], None
    else:
        rig = load_rig(options.rig)
        servos, joints = build_servos(rig, configured=options.configured, baud_rate=options.baud_rate)
        for servo, joint in zip(servos, joints, strict=True) if options.astray else ():
            servo.astray = options.astray[joint]
    plant = None if options.plant is None else _plant(options.plant)
    bus = EmulatedBus(servos, joints, plant, paced=options.paced, seed=options.seed)
    bus.set_faults(parse_faults(options.faults, bus.ids))
    return bus


def _servo(text: str, baud_rate: int) -> EmulatedServo:
    number, _, model = text.partition("=")
    if not number.isdecimal() or int(number) > LAST_ID:
        raise HighFiveError(f"no servo {text!r}; give it as ID=MODEL, such as 1=XL430-W250")
    return EmulatedServo(load_table(model), {"id": int(number), "baud_rate": baud_index(baud_rate)})


def _plant(name: str) -> Any:
    module, _, rest = name.partition(":")
    function, _, argument = rest.partition(":")
    try:
        return getattr(importlib.import_module(module), function)(*([argument] if argument else []))
    except (ImportError, AttributeError, ValueError) as error:
        raise HighFiveError(f"no plant {name!r} ({error}); give it as package.module:function[:ARGUMENT]") from None


class EmulatorProcess:
    """An emulator that runs while this context lasts.

    Attributes:
        port: what a host opens.
        summary: as :class:`~highfive.hil.drivers.emulator.emulator.EmulatorSummary` has it, by name; empty until the
        context has ended.
    """

    def __init__(self, options: EmulatorOptions | None = None) -> None:
        """Nothing runs yet."""
        self._options = options or EmulatorOptions()
        self._process: subprocess.Popen[str] | None = None
        self.port = ""
        self.summary: dict[str, Any] = {}

    def __enter__(self) -> EmulatorProcess:
        """Starts it, and waits until its port is there.

        Raises:
            HighFiveError: it could not start; it says why.
        """
        self._process = subprocess.Popen(
            [sys.executable, "-m", "highfive.hil.drivers.emulator.emulator_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._say(json.dumps(asdict(self._options)))
        said = self._heard()
        if "port" not in said:
            self.__exit__(None, None, None)
            raise HighFiveError(said.get("error", "the emulator ended before it began"))
        self.port = said["port"]
        return self

    def set_faults(self, faults: str | Iterable[str]) -> None:
        """From now on only these go wrong, and their times count from now; an empty text ends all.

        They are in force when this returns.

        Raises:
            HighFiveError: they are spelt wrongly, or of a servo that is not there, or it has ended.
        """
        texts = [faults] if isinstance(faults, str) else list(faults)
        parse_faults(texts)
        self._say(",".join(texts))
        said = self._heard()
        if "faults" not in said:
            raise HighFiveError(said.get("error", _ENDED))

    def kill(self) -> None:
        """Ends it as a power cut would."""
        if self._process is not None:
            self._process.kill()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ends it, and keeps its summary."""
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            return
        with suppress(OSError):  # it may be gone already
            process.stdin.close()
        self.summary = self._heard()
        process.stdout.close()
        try:
            process.wait(_ENDING_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def _say(self, line: str) -> None:
        if self._process is None or self._process.stdin is None:
            raise HighFiveError("the emulator does not run; start it with a with statement")
        try:
            self._process.stdin.write(line + "\n")
            self._process.stdin.flush()
        except OSError:
            raise HighFiveError(_ENDED) from None

    def _heard(self) -> dict[str, Any]:
        line = self._process.stdout.readline() if self._process and self._process.stdout else ""
        return json.loads(line) if line.strip() else {}


def _child(instructions: TextIO, answers: TextIO) -> int:
    def answer(what: dict[str, Any]) -> None:
        try:
            answers.write(json.dumps(what) + "\n")
            answers.flush()
        except BrokenPipeError:  # the parent is gone; Python shall not try again at the end
            os.dup2(os.open(os.devnull, os.O_WRONLY), answers.fileno())

    try:
        given = json.loads(instructions.readline())
        options = EmulatorOptions(**given | {name: tuple(given[name]) for name in ("faults", "servos", "astray")})
        with Emulator(make_bus(options), link=options.link) as emulator:
            answer({"port": emulator.port})
            ended = threading.Event()
            threading.Thread(target=_listen, args=(instructions, emulator, ended, answer), daemon=True).start()
            go_first()  # servos do not wait for the host's processor
            answer(asdict(emulator.run(ended.is_set)))
    except HighFiveError as error:
        answer({"error": str(error)})
        return 2
    return 0


def _listen(
    instructions: TextIO, emulator: Emulator, ended: threading.Event, answer: Callable[[dict[str, Any]], None]
) -> None:
    try:
        for line in instructions:
            try:
                emulator.set_faults(line.strip()).wait()
            except HighFiveError as error:
                answer({"error": str(error)})
            else:
                answer({"faults": line.strip()})
    finally:
        ended.set()


if __name__ == "__main__":
    # The parent gets them too, and ends this in time; servos are not suspended with their host.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGTSTP):
        signal.signal(number, signal.SIG_IGN)
    sys.exit(_child(sys.stdin, sys.stdout))
