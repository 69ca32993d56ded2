"""``highfive rig draft``: an own arm's limits and rig, as far as its model and its servos say; to be looked at."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from highfive.hil.arm.arm_files import limits_of, rig_of
from highfive.hil.arm_model.arm_folder import ARMS, ArmFolder, find_arm
from highfive.hil.arm_model.from_mujoco import compiled_body
from highfive.hil.arm_model.servo_arm import mounted
from highfive.hil.commands.rig.draft_notes import BY_DUTY, LIMITS_NOTES, RIG_NOTES, noted
from highfive.hil.drivers.bus.control_table import load_table
from highfive.hil.runtime.folders import check_file
from highfive.model.errors import HighFiveError
from highfive.model.files import write_whole
from highfive.model.geometry.rotations import Array

LIMITS, RIG = "limits.toml", "rig.toml"
PATTERN = ARMS / "koch_v1_1" / LIMITS
"""Whose limits of everything but joints are taken."""
INSIDE = math.radians(1.0)
"""rad, by which positions stay off the stops."""
FASTEST, SHARE = 3.14, 0.9
"""rad/s, and of the servo's no-load speed: what joints may have."""
BRAKING = 0.5
"""Of the acceleration: what a joint can be relied on to slow down by."""
FREE, HOLDING, MOST = 0.85, 1.5, 2.0
"""Of the stall current in free motion; of what holds the stretched arm, near hands; A, most of that."""
LEAST, LEAST_DUTY = 0.35, 0.7
"""Of the stall current near hands, at the least: with less a joint cannot follow. A servo that limits its duty is
limited in speed by it, too."""
GAIN = 2400


def draft_rig(name: str, overwrite: bool) -> dict[str, Any]:
    """Writes what is missing of an arm's folder: limits and rig.

    Args:
        name: the folder, with its model and its ``arm.toml``.
        overwrite: replace files that are there.

    Raises:
        HighFiveError: there is no such arm, a file is there already or cannot be written, or what was written is
            nothing that the arm can be driven by; one line says why.
    """
    folder = find_arm(name)
    if folder.folder.parent == ARMS:
        raise HighFiveError(f"{folder.name} comes with its limits and its rig; give the folder of an arm of your own")
    files = {folder.folder / LIMITS: drafted_limits(folder), folder.folder / RIG: drafted_rig(folder)}
    for file in files:
        check_file(file, overwrite, "folder")
    new = [file for file in files if not file.exists()]
    try:
        for file, text in files.items():
            write_whole(file, text.encode(), replace=overwrite)
        limits_of(folder)
        rig = rig_of(folder)
    except (OSError, HighFiveError) as error:
        for one in new:  # so that it can be tried again
            one.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise HighFiveError(f"cannot write {error.filename or folder.folder}: {error.strerror or error}") from None
        raise
    return {
        "arm": folder.name,
        "files": [str(file) for file in files],
        "ids": {joint.name: list(joint.ids) for joint in rig.joints},
    }


def drafted_limits(folder: ArmFolder) -> str:
    """The content of ``limits.toml``."""
    body, each = compiled_body(folder), folder.each
    currents = contact_currents(folder)
    tables = []
    for j, joint in enumerate(folder.joints):
        low, high = max(body.low[j], -math.pi) + INSIDE, min(body.high[j], math.pi) - INSIDE
        by_duty = {} if load_table(joint.model).limits_current else BY_DUTY
        table = (
            f"[joint.{joint.name}]\n"
            f"lowest = {low:.3f}\n"
            f"highest = {high:.3f}\n"
            f"speed = {min(FASTEST, folder.speed_limit, SHARE * each[1][j]):.2f}\n"
            f"acceleration = {joint.acceleration:.1f}\n"
            f"braking = {BRAKING * joint.acceleration:.1f}\n"
            f"current = {FREE * joint.servo.stall_current:.2f}\n"
            f"contact_current = {currents[j]:.2f}\n"
        )
        tables.append(noted(table, {**LIMITS_NOTES, **by_duty}))
    text = PATTERN.read_text(encoding="utf-8")
    before, rest = text[text.index("[servo]") :].split("[retract]")
    after = rest[rest.index("[timing]") :]
    ready = ", ".join(f"{angle:.3f}" for angle in folder.ready)
    head = (
        f"# What may be sent to: {folder.name}. Drafted by highfive rig draft from its model and its servos: look at\n"
        "# each entry (docs/safety.md says what it is for). [retract] is where the arm goes back along, and rests\n"
        "# last: it is where it waits, until you know a pose in which it lies safely without torque.\n"
    )
    path = f"[retract]\npath = [\n    [{ready}],\n    [{ready}],\n]\n\n"
    return head + "\n".join(tables) + "\n" + noted(before + path + after, LIMITS_NOTES)


def contact_currents(folder: ArmFolder) -> Array:
    """(J,) A a servo, that hold the arm in any posture, with something to spare to move."""
    arm, body = mounted(folder), compiled_body(folder)
    low, high = np.maximum(body.low, -math.pi), np.minimum(body.high, math.pi)
    drawn = np.random.default_rng(0).uniform(low, high, (500, len(low)))
    most = np.max(np.abs([arm.gravity(joints) for joints in drawn]), axis=0)
    for name, needed, strength in zip(folder.names, most, folder.each[0], strict=True):
        if needed > FREE * strength:
            raise HighFiveError(
                f"{name} has to hold {needed:.1f} N·m somewhere, its servos give {FREE * strength:.1f} for long: take "
                "stronger ones, two of them, or a lighter arm (is the model in kg and m?)"
            )
    each = most / folder.each[0] * folder.stall_currents
    least = [LEAST if load_table(joint.model).limits_current else LEAST_DUTY for joint in folder.joints]
    return np.clip(HOLDING * each, least * folder.stall_currents, np.minimum(FREE * folder.stall_currents, MOST))


def drafted_rig(folder: ArmFolder) -> str:
    """The content of ``rig.toml``: IDs from 1 in the order of the joints, zeros in the middle, none reversed."""
    body, pattern = compiled_body(folder), (ARMS / "koch_v1_1" / RIG).read_text(encoding="utf-8")
    settings = pattern[pattern.index("[settings]") : pattern.index("[[joints]]")]
    tables, servo = [], 1
    for j, joint in enumerate(folder.joints):
        low, high = np.degrees([max(body.low[j], -math.pi), min(body.high[j], math.pi)])
        shadow = f"shadow_id = {servo + 1}\n" if joint.servos == 2 else ""
        by_duty = {} if load_table(joint.model).limits_current else BY_DUTY
        table = (
            f'[[joints]]\nname = "{joint.name}"\nmodel = "{joint.model}"\nid = {servo}\n{shadow}'
            f"reversed = false\nzero = 2048\nlimits_deg = [{low:.1f}, {high:.1f}]\n"
            f"current_limit_A = {FREE * joint.servo.stall_current:.2f}\nposition_p_gain = {GAIN}\n"
        )
        tables.append(noted(table, {**RIG_NOTES, **by_duty}))
        servo += joint.servos
    head = (
        "# Drafted by highfive rig draft. IDs are guessed (highfive rig scan lists them), no joint is reversed, and\n"
        "# zeros are in the middle of the servos' turns; what each entry means: docs/rig.md.\n\n"
    )
    whole = f'name = "{folder.name}"\nbaud_rate = 1_000_000\n\n{settings}'
    return head + noted(whole, RIG_NOTES) + "\n".join(tables)


def print_draft(result: dict[str, Any]) -> None:
    """What was written, for people."""
    for file in result["files"]:
        print(f"drafted: {file}")
    ids = ", ".join(f"{name} {' and '.join(map(str, own))}" for name, own in result["ids"].items())
    print(f"servos are taken to be: {ids}. Look at every entry; rig emulate --arm shows them on a bus")
