"""What stands beside each entry of a drafted arm's files: its unit, what it was taken from, whether to change it."""

from __future__ import annotations

import re
from collections.abc import Mapping

_SAFER = "lower it if you like"
_SETTING = "a setting, as for the Koch v1.1; keep it"
_STANDARD = "ISO/TS 15066 (docs/safety.md); keep it"

LIMITS_NOTES: Mapping[str, str] = {
    "joint.lowest": "rad; the model's stop and 1 degree; raise it to keep the joint from where it must not go",
    "joint.highest": "rad; the model's stop less 1 degree; lower it to keep the joint from where it must not go",
    "joint.speed": f"rad/s; 90 % of the servo's no-load speed, at most arm.toml's limit and 3.14; {_SAFER}",
    "joint.acceleration": f"rad/s²; of arm.toml; {_SAFER}",
    "joint.braking": "rad/s²; half of the acceleration, an estimate; measure what it brakes by, stretched",
    "joint.current": "A a servo; 85 % of its stall current; as current_limit_A of rig.toml",
    "joint.contact_current": "A a servo, near a hand; 1.5 times what holds the model; lower it as long as it holds",
    "servo.temperature": "°C; 5 below the servos' own limit; keep it",
    "servo.voltage_low": "V at a servo for 12 V, at others the same share of theirs; check your supply",
    "servo.voltage_high": "V at a servo for 12 V, at others the same share of theirs; check your supply",
    "servo.following": f"rad, behind what was sent; {_SETTING}",
    "servo.following_s": f"s, so long; {_SETTING}",
    "servo.shadow": f"rad, between two servos of a joint; {_SETTING}",
    "servo.shadow_s": f"s, so long; {_SETTING}",
    "servo.shadow_rest": "rad, the same at rest; 8 counts of play; keep it",
    "servo.silent_s": "s without an answer; keep it",
    "servo.health_s": f"s, age of the newest temperatures and voltages; {_SETTING}",
    "posture.rest": f"rad, by which a held arm may be off its rest; {_SETTING}",
    "posture.stop": f"rad, by which a joint on its stop may be off it; {_SETTING}",
    "posture.touch": f"m, nearer than that it may lie on something; {_SETTING}",
    "posture.through": "m, by which the model's shapes are too big; look at your model's shapes",
    "posture.friction": "of the stall torque; an estimate; keep it",
    "posture.model": "of gravity's torque; an estimate; lower it if your model's masses are weighed",
    "contact.force": f"N; {_STANDARD}",
    "contact.body_mass": f"kg, of a hand; {_STANDARD}",
    "contact.robot_mass": "kg; half of what moves, and the plate; CHANGE it for your arm",
    "contact.stiffness": f"N/m, of a hand; {_STANDARD}",
    "contact.speed": "m/s, of plate and hand; follows from the four above; lower it if robot_mass is more",
    "contact.near": f"m, from where on that holds; {_SETTING}",
    "contact.touching": f"m; nearer, a direction is noise; {_SETTING}",
    "contact.braking": f"m/s²; {_SETTING}",
    "face.force": f"N; {_STANDARD}",
    "face.body_mass": f"kg, of a head; {_STANDARD}",
    "face.robot_mass": "kg; as for contact; CHANGE it for your arm",
    "face.stiffness": f"N/m, of a face; {_STANDARD}",
    "face.speed": "m/s, near a head; follows from the four above; lower it if robot_mass is more",
    "face.radius": "m, around the head's centre; larger if your plate is",
    "face.braking": f"m/s²; {_SETTING}",
    "stale.hold_s": "s without a measurement of the person; keep it",
    "stale.retract_s": "s, then it goes back; keep it",
    "motion.catch_up": f"rad/s, faster than requested, to make up for being behind; {_SETTING}",
    "motion.retract": f"rad/s, on the way back; {_SETTING}",
    "motion.point_speed": f"m/s, of any point of the arm; {_SAFER}",
    "feed_forward.largest": f"rad, that goals may lead by; {_SETTING}",
    "feed_forward.speed": f"rad/s; {_SETTING}",
    "feed_forward.acceleration": f"rad/s²; {_SETTING}",
    "retract.path": "rad, joint by joint; where it waits, twice; CHANGE the last one to where it lies without torque",
    "timing.period_s": "s; 120 Hz; keep it",
    "timing.late_run": f"late commands in a row, that stop it; {_SETTING}",
    "timing.watchdog_s": "s; as watchdog_s of rig.toml; keep it",
    "timing.estop_s": "s; keep it",
}
"""Of ``limits.toml``, by section and key; of a joint's own table without its name."""

RIG_NOTES: Mapping[str, str] = {
    "name": "of arm.toml; for people",
    "baud_rate": "of the line; change it if your servos are set to another (highfive rig scan)",
    "settings.return_delay_s": "s before a servo answers; keep it",
    "settings.operating_mode": "5: position with a largest current; keep it, also for servos that cannot: they get 3",
    "settings.velocity_limit": "0.229 rev/min: 30 rev/min; keep it",
    "settings.watchdog_s": "s without a word after which a servo stops; keep it",
    "settings.status_return_level": "2: servos answer everything; keep it",
    "settings.homing_offset": "counts; keep it, zero is what zeros of joints are for",
    "settings.temperature_limit_C": "°C, at which a servo switches itself off; keep it",
    "joints.name": "of arm.toml",
    "joints.model": "of arm.toml",
    "joints.id": "counted from the base; CHANGE it to what highfive rig scan lists",
    "joints.shadow_id": "of the second servo; CHANGE it to what highfive rig scan lists",
    "joints.reversed": "true where the servo turns against the model; turn the limp joint and look",
    "joints.zero": "counts at the model's angle 0; the middle of the turn; CHANGE it to what you read there",
    "joints.limits_deg": "degrees; the model's stops, at most ±180; keep them, and change limits.toml",
    "joints.current_limit_A": "A a servo; 85 % of its stall current; lower it for softer joints, with limits.toml",
    "joints.position_p_gain": "a plain number; stiffness, as of our other arms; lower it if the joint hums",
}
"""Of ``rig.toml``; of ``[[joints]]`` as ``joints``."""

BY_DUTY: Mapping[str, str] = {
    "joint.current": "A a servo; it cannot limit its current: a largest duty is made of it; keep it",
    "joint.contact_current": "A a servo, near hands; it cannot limit its current: a largest duty is made of it",
    "joints.current_limit_A": "A a servo; it cannot limit its current: a largest duty is made of it; keep it",
}
"""In place of these, of joints whose servos do not limit their current."""

_ENTRY = re.compile(r"([a-z_A-Z]+) = ([^#\n]*[^#\s])[ \t]*(?:#.*)?")
_HEADING = re.compile(r"\[+([a-z_]+)(?:\.[^\]]+)?\]+")


def noted(text: str, notes: Mapping[str, str]) -> str:
    """A drafted file with a note at the end of each entry's first line.

    Args:
        text: TOML of one line an entry; of lists of lists the first line has the opening bracket alone.
        notes: by section and key.

    Raises:
        KeyError: an entry has no note.
    """
    lines, section = [], ""
    for line in text.splitlines():
        if heading := _HEADING.fullmatch(line):
            section = f"{heading[1]}."
        elif entry := _ENTRY.fullmatch(line):
            lines.append(f"{entry[1]} = {entry[2]}  # {notes[section + entry[1]]}")
            continue
        lines.append(line)
    return "\n".join(lines) + "\n"
