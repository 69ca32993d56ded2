"""What a new calibration of the room keeps of an arm's servos, and that known play is no error of its fit."""

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
from hidden_poses import UP, postures, seen_poses
from kept_arm import DATE, kept_arm

from highfive.calibration.arm_file import ArmCalibration
from highfive.calibration.arm_fit import fit_arm
from highfive.calibration.kept_servos import LAGS, SEEN, SERVOS, KeptServos, kept_servos, with_servos, without_play
from highfive.hil.arm.drawn_shape import drawn_shape
from highfive.hil.arm.hidden_arm import TEMPLATE, drawn_truth
from highfive.hil.arm_model.servo_arm import default_arm

ARM = "0123456789ab"
NOW = DATE + timedelta(days=20)


def before() -> ArmCalibration:
    """With servos measured ten days after the room, and lags."""
    joints = {name: replace(joint, play=0.004) for name, joint in kept_arm().joints.items()}
    return replace(
        kept_arm(),
        joints=joints,
        latency={"elbow_lag_s": 0.031, "mocap_age_s": 0.012},
        servos_date=DATE + timedelta(days=10),
        latency_date=DATE - timedelta(days=5),
    )


def bare() -> ArmCalibration:
    """As a new one of the room comes out: nothing of its servos was measured."""
    joints = {name: replace(joint, zero=0.01, friction=None, shadow=None) for name, joint in kept_arm().joints.items()}
    return replace(kept_arm(), joints=joints)


def test_servos_and_lags_go_into_the_new_one_and_zeros_do_not() -> None:
    kept = kept_servos(before(), ARM, "vicon", NOW)
    new = with_servos(bare(), kept)
    assert not kept.dropped
    for name, joint in new.joints.items():
        old = before().joints[name]
        assert (joint.play, joint.friction, joint.shadow) == (old.play, old.friction, old.shadow)
        assert joint.zero == 0.01
    assert new.latency == before().latency
    assert (new.servos_date, new.latency_date) == (before().servos_date, before().latency_date)
    assert new.registration.date == bare().registration.date


@pytest.mark.parametrize(
    ("arm", "system", "days", "dropped", "says"),
    [
        ("another", "vicon", 20, {SERVOS, LAGS, SEEN}, "of another arm"),
        (ARM, "vicon", 26, {LAGS, SEEN}, "31 days old"),
        (ARM, "vicon", 41, {SERVOS, LAGS, SEEN}, "days old, at most 30"),
        (ARM, "qtm", 20, {SEEN}, "they are of a vicon system"),
    ],
)
def test_what_is_no_longer_valid_is_said(arm: str, system: str, days: int, dropped: set[str], says: str) -> None:
    kept = kept_servos(before(), arm, system, DATE + timedelta(days=days))
    assert set(kept.dropped) == dropped
    assert all(says in why for why in kept.dropped.values())
    new = with_servos(bare(), kept)
    assert ("elbow_lag_s" in new.latency, "mocap_age_s" in new.latency) == (LAGS not in dropped, SEEN not in dropped)
    assert (new.latency_date is None) == (LAGS in dropped)
    assert (new.joints["elbow"].friction is None) == (SERVOS in dropped)
    assert (new.servos_date is None) == (SERVOS in dropped)


def test_a_calibration_without_servos_has_nothing_to_keep_or_to_drop() -> None:
    assert kept_servos(bare(), "another", "qtm", DATE + timedelta(days=99)) == KeptServos()


def test_known_play_is_no_error_of_the_fit() -> None:
    """Postures from either side of every joint: with its play known an arm fits as well as one that has none."""
    shape, truth = drawn_shape(default_arm(), TEMPLATE.markers), replace(drawn_truth(3), play=np.full(6, 0.006))
    poses = seen_poses(truth, postures(30))
    assert np.abs(poses.sides).min() == 1.0
    blind = fit_arm(shape, poses, UP)
    known = fit_arm(shape, without_play(poses, truth.play), UP)
    ideal = fit_arm(shape, seen_poses(replace(truth, play=np.zeros(6)), postures(30)), UP)
    assert known.rms < 1.1 * ideal.rms < 0.7 * blind.rms
