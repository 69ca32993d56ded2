"""TOML files of each kind, and what reads them."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from highfive.calibration.arm_file import DIGEST, ArmCalibration, CalibratedJoint, KeptPose, arm_text, load_arm, signed
from highfive.calibration.headset_file import load_headset
from highfive.calibration.latency_file import load_latencies
from highfive.calibration.placement_file import load_placement
from highfive.calibration.plate_template import load_template, template_text
from highfive.calibration.registration import Registration
from highfive.hil.arm.hidden_arm import TEMPLATE
from highfive.hil.arm_model.arm_folder import ARMS, find_arm
from highfive.hil.bench.fuzz_mutations import damaged_toml
from highfive.hil.bench.fuzz_reader import Seed, of_file
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.experiments.analysis.questionnaire import read_questionnaire
from highfive.hil.experiments.exclusion import read_rules
from highfive.hil.experiments.observer import read_observer
from highfive.hil.experiments.plan import draw_plan
from highfive.hil.experiments.plan_file import plan_toml, read_plan
from highfive.hil.experiments.protocol_file import TEMPLATES, read_protocol
from highfive.hil.experiments.words import read_words
from highfive.hil.safety.limits_file import FILE, load_limits
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set, marker_set_text

_META = "[meta]\nformat = 1\ndate = 2026-11-23T09:30:00Z\n"
_PLACEMENT = f'{_META}\n[world]\nsystem = "vicon"\nrotation = [1.0, 0.0, 0.0, 0.0]\ntranslation_m = [0.5, 0.0, 0.25]\n'
_LATENCIES = (
    '[meta]\nformat = 1\n\n[stream."/lsl/EEG"]\nlatency_ms = 31.250\nbound_ms = 1.500\nevents = 20\n'
    'reference = "person"\nsource = "session.mcap"\ndate = "2026-11-23T09:30:00Z"\n'
)
_HEADSET = (
    f'{_META}\n[headset]\nsystem = "vicon"\nmarker_set = "upper_limb"\nrotation = [1.0, 0.0, 0.0, 0.0]\n'
    "translation_m = [0.5, 0.0, 0.25]\neyes_rotation = [1.0, 0.0, 0.0, 0.0]\neyes_translation_m = [0.0, 0.0, 0.0]\n"
    "delay_s = 0.02\nresidual_m = 0.001\nresidual_rad = 0.01\nhand_sigma_m = 0.01\n"
)
_RULES = (
    '[[trials]]\nwhy = "faster than anybody sees it"\ncolumn = "rt_s"\nbelow = 0.2\nconditions = ["interactive"]\n\n'
    '[[trials]]\nwhy = "stood still"\ncolumn = "answer"\nis = "angry"\n\n'
    '[[people]]\nwhy = "too little counts"\nnot_counted_above = 0.25\n'
)
_QUESTIONNAIRE = (
    'name = "own"\nlicence = "CC0"\nsource = "written"\nlow = 1\nhigh = 7\nanswers = "own.csv"\n[[items]]\n'
    'name = "natural"\nsubscale = "liveliness"\nlow = "artificial"\nhigh = "natural"\n[[items]]\nname = "stiff"\n'
    'subscale = "liveliness"\nreversed = true\n'
)
_OBSERVER = (
    "seed = 3\n[interactive]\nright = 0.8\npse = 0.5\njnd = 0.2\nlapse = 0.02\n[interactive.confusion.angry]\n"
    "angry = 0.7\nsad = 0.3\n[replay]\nright = 0.6\n[reaction]\nmedian_s = 0.8\nspread = 0.3\nsilent = 0.0\n"
)
_WORDS = (
    '[page]\n[answers]\nangry = "wütend"\nsad = "traurig"\n[sliders.valence]\ntext = "Wie?"\nlow = "schlecht"\n'
    'high = "gut"\n'
)


def toml_seeds() -> list[Seed]:
    """One of each kind, and of some several."""
    protocols = [read_protocol(path) for path in sorted(TEMPLATES.glob("*.toml"))]
    named: list[tuple[str, str, Callable[[Path], Any]]] = [
        ("set.toml", marker_set_text(load_marker_set("upper_limb")), load_marker_set),
        ("limits.toml", FILE.read_text(encoding="utf-8"), load_limits),
        ("rig.toml", (ARMS / "koch_v1_1" / "rig.toml").read_text(encoding="utf-8"), load_rig),
        ("place.toml", _PLACEMENT, lambda path: load_placement(path, "vicon")),
        ("latencies.toml", _LATENCIES, load_latencies),
        ("headset.toml", _HEADSET, lambda path: load_headset(path, "vicon", "upper_limb")),
        ("plate.toml", template_text(TEMPLATE), load_template),
        ("rules.toml", _RULES, read_rules),
        ("asked.toml", _QUESTIONNAIRE, read_questionnaire),
        ("observer.toml", _OBSERVER, read_observer),
        ("de.toml", _WORDS, lambda path: read_words(path.parent, ("angry", "sad"), ("valence",))),
        ("arm.toml", arm_text(sound_calibration()), _load_signed),
        (
            "arm.toml",
            (ARMS / "vx300s" / "arm.toml").read_text(encoding="utf-8"),
            lambda path: find_arm(f"{path.parent}"),
        ),
        ("plan.toml", plan_toml(draw_plan(protocols[0], 1)).decode(), read_plan),
    ]
    named += [(path.name, path.read_text(encoding="utf-8"), read_protocol) for path in sorted(TEMPLATES.glob("*.toml"))]
    return [Seed(text.encode(), of_file(name, read), damaged_toml) for name, text, read in named]


def _load_signed(path: Path) -> ArmCalibration:
    """A calibration, signed anew where it has a place for that: else all that is damaged ends at its sum."""
    body, found, _ = path.read_bytes().decode("utf-8", "replace").rpartition(DIGEST)
    if found:
        path.write_text(signed(body), encoding="utf-8", newline="")
    return load_arm(path)


def sound_calibration() -> ArmCalibration:
    """Of the shipped arm, measured on 23 November 2026."""
    unit, date = np.array([1.0, 0.0, 0.0, 0.0]), datetime(2026, 11, 23, 9, 30, tzinfo=UTC)
    joint = CalibratedJoint(0.01, 0.001, 0.002, np.full(3, 0.0005), np.full(3, 0.001), friction=0.25, shadow=0.003)
    names = find_arm().names
    return ArmCalibration(
        registration=Registration(Path("room.toml"), date, "0123456789ab", "vicon", unit, np.zeros(3), 30, 0.0025),
        tool="0.2.0",
        command="highfive calibrate extrinsics",
        note="a note",
        mount=np.array([-0.07, -0.08, 1.28]),
        mount_rotation=unit,
        plate=TEMPLATE.centre,
        plate_normal=TEMPLATE.normal,
        marker_names=TEMPLATE.names,
        markers=TEMPLATE.markers,
        joints=dict.fromkeys(names, joint),
        held_out_median=0.0012,
        held_out_max=0.0031,
        rms=0.0008,
        temperatures=(31.0, 38.0),
        latency={},
        poses=(KeptPose(np.zeros(len(names)), 0.001, 0.002), KeptPose(np.ones(len(names)), 0.001, None)),
    )
