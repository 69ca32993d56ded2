"""``highfive rig emulate``: servos on a pseudo-terminal until they are ended."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import asdict, replace
from typing import Any

from highfive.hil.arm.arm_files import rig_file
from highfive.hil.arm.lifecycle import PLANT
from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm
from highfive.hil.commands.rig.rehearsal import RehearsalOptions, differences, hidden_lines, rehearsed_arm
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.emulator import Emulator
from highfive.hil.drivers.emulator.emulator_process import EmulatorOptions, make_bus
from highfive.hil.drivers.priority import go_first
from highfive.hil.runtime.shutdown import until_ended
from highfive.model.errors import HighFiveError


def emulate(
    options: EmulatorOptions,
    seconds: float | None,
    say: Callable[[str], None],
    arm: str = DEFAULT_ARM,
    rehearsal: RehearsalOptions | None = None,
) -> dict[str, Any]:
    """Serves the emulated bus until Ctrl-C or SIGTERM, or for so long; ``say`` gets lines for people.

    The servos of a rig with the joints of ``arm`` (a name or folder) move its twin, others an inertia per joint. With a
    ``rehearsal`` they move an arm that is not as drawn, whose plate a motion capture system sees.

    Every line that comes in on standard input replaces what goes wrong, with times that count from then.

    Returns:
        ``port``, ``rig``, ``servos`` (model by ID), of a rehearsal ``source`` and ``hidden``, and what
        :class:`~highfive.hil.drivers.emulator.emulator.EmulatorSummary` holds.

    Raises:
        HighFiveError: rig, faults or link make no sense, or there are no pseudo-terminals.
    """
    folder = find_arm(arm)
    if options.rig is None:
        options = replace(options, rig=str(rig_file(folder)))
    rig = load_rig(options.rig)
    if options.plant is None and tuple(joint.name for joint in rig.joints) == folder.names:
        options = replace(options, plant=f"{PLANT}:{arm}")
    seen: dict[str, Any] = {}
    with until_ended() as end, ExitStack() as stack:
        if rehearsal is None:
            bus = make_bus(options)
        else:
            bus, source, truth = stack.enter_context(rehearsed_arm(rehearsal, options, rig, folder))
            seen = {"source": source, "hidden": differences(truth)}
        emulator = stack.enter_context(Emulator(bus, link=options.link))
        say(f"{emulator.port}: {rig.name}, {options.baud_rate or rig.baud_rate:,} baud")
        for joint in rig.joints:
            ids = " and ".join(map(str, joint.ids))
            say(f"  {joint.name:<14}ID {ids:<9}{joint.model}")
        if rehearsal is not None:
            told = f"{emulator.port} --source {seen['source']} --plate {rehearsal.plate} --arm"
            say(f"its plate is seen; in another terminal: highfive calibrate extrinsics {told}")
        say("Ctrl-C ends it; a line such as dead=4 sets what goes wrong, an empty one ends that")
        if _may_read_input():
            threading.Thread(target=_listen, args=(emulator, say), daemon=True).start()
        go_first()
        summary = asdict(emulator.run(end.is_set, seconds))
    return {"port": emulator.port, "rig": rig.name, "servos": rig.models, **seen, **summary}


def print_emulated(result: dict[str, Any]) -> None:
    """What was served, for people."""
    served = sum(result["instructions"].values())
    print(f"{served} instructions in {result['seconds']:.1f} s, {result['errors']} answered with an error")
    for name, count in sorted(result["instructions"].items(), key=lambda item: -item[1]):
        print(f"  {name:<22}{count}")
    if "hidden" in result:
        print(*hidden_lines(result["hidden"]), sep="\n")
    for label, key in (
        ("damaged instructions", "damaged"),
        ("instructions into a reply", "collisions"),
        ("replies not fetched", "overruns"),
        ("watchdog trips", "watchdog_trips"),
    ):
        if result[key]:
            print(f"{label + ':':<28}{result[key]}")


def _may_read_input() -> bool:
    """Not where standard input is a terminal that belongs to another job: reading would stop this one."""
    try:
        return not sys.stdin.isatty() or os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (OSError, ValueError, AttributeError):
        return False


def _listen(emulator: Emulator, say: Callable[[str], None]) -> None:
    for line in sys.stdin:
        try:
            emulator.set_faults(line.strip())
            say(f"from now on: {line.strip() or 'nothing goes wrong'}")
        except HighFiveError as error:
            say(str(error))
