"""A calibration of an arm as it is kept, and the same with values changed and signed again."""

import hashlib
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from highfive.calibration.arm_file import DIGEST, ArmCalibration, CalibratedJoint, KeptPose, arm_text
from highfive.calibration.registration import Registration
from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.bench.hidden_arm import TEMPLATE

DATE = datetime(2026, 11, 23, 9, 30, tzinfo=UTC)


def kept_arm() -> ArmCalibration:
    """One that is good, measured at :data:`DATE`."""
    unit, rng = np.array([1.0, 0.0, 0.0, 0.0]), np.random.default_rng(0)
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
    return ArmCalibration(
        registration=Registration(Path("room.toml"), DATE, "0123456789ab", "vicon", unit, np.zeros(3), 30, 0.0025),
        tool="0.2.0",
        command="highfive calibrate extrinsics",
        note='a "new" plate\\horn',
        mount=np.array([-0.07, -0.08, 1.28]),
        mount_rotation=unit,
        plate=TEMPLATE.centre,
        plate_normal=TEMPLATE.normal,
        marker_names=TEMPLATE.names,
        markers=TEMPLATE.markers,
        joints=joints,
        held_out_median=0.0012,
        held_out_max=0.0031,
        rms=0.0008,
        temperatures=(31.0, 38.0),
        latency={},
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
    return f'{body}{DIGEST}"{hashlib.sha256(body.encode()).hexdigest()}"\n'
