"""A calibration of an arm as it is kept, and the same with values changed and signed again."""

from dataclasses import replace

import numpy as np

from highfive.calibration.arm_file import DIGEST, ArmCalibration, CalibratedJoint, KeptPose, arm_text, signed
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.bench.fuzz_toml import sound_calibration

DATE = sound_calibration().registration.date


def kept_arm() -> ArmCalibration:
    """One that is good, measured at :data:`DATE`."""
    rng = np.random.default_rng(0)
    joints = {
        name: CalibratedJoint(
            zero=rng.normal(0.0, 0.02),
            compliance=rng.uniform(0.0, 0.003),
            play=0.0,
            length=rng.normal(0.0, 0.0007, 3),
            tilt=rng.normal(0.0, 0.003, 3),
            friction=0.25,
            shadow=0.003 if name == "elbow" else None,
        )
        for name in find_arm().names
    }
    return replace(
        sound_calibration(),
        note='a "new" plate\\horn',
        joints=joints,
        poses=tuple(
            KeptPose(rng.uniform(-1.0, 1.0, len(joints)), 1e-3 * n, None if n == 2 else 2e-3 * n) for n in range(1, 4)
        ),
    )


def kept_text() -> str:
    """Its file."""
    return arm_text(kept_arm())


def changed(text: str, **changes: str) -> str:
    """The first line that gives each name has another value; the file is signed again."""
    lines = text.splitlines()
    for name, value in changes.items():
        at = next(n for n, line in enumerate(lines) if line.startswith(f"{name} = "))
        lines[at] = f"{name} = {value}"
    body = "\n".join(lines).rpartition(DIGEST)[0]
    return signed(body)
