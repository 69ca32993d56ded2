"""Trial results for the tests of what a session writes: simulated pairs, with a slightly wrong 'generated' answer."""

from functools import cache

import numpy as np

from highfive.hil.sim.avatar import Pose, avatar_skeleton, right_palm
from highfive.hil.sim.contact_check import contact_report
from highfive.hil.sim.people.actors import PairTrial, simulate_pair
from highfive.hil.sim.people.capture import PERSON_SET, markers_of
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.people.role import RATE_HZ
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import Scene, build_scene
from highfive.hil.trials.trial_result import TrialResult
from highfive.mocap_bridge.frames import HumanArm, TrackedMarkers
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.tracking.human_arm import HumanArmEstimator
from highfive.model.online.contact_forecast import ContactForecast


def simulated_result(
    scene: Scene, number: int, emotion: str, cell: str, *, away: float = 0.0, seed: int = 5
) -> TrialResult:
    """A trial whose avatar plays the simulated actor's motion; ``away`` m puts it too far back to meet the person."""
    rng = np.random.default_rng([seed, number])
    trial = simulate_pair(emotion, cell, 0, rng)
    people, markers = _people(trial)
    skeleton = avatar_skeleton()
    root = trial.avatar.root_in_world - [away, 0.0, 0.0]
    poses = [Pose.from_quaternions(*pair) for pair in zip(root, trial.avatar.quaternions, strict=True)]
    generated = [Pose.from_quaternions(*pair) for pair in zip(root, _perturbed(trial, rng), strict=True)]
    playout = KinematicPlayOut(scene)
    states = []
    for i, (pose, person) in enumerate(zip(poses, people, strict=True)):
        states.append((playout.step if i else playout.reset)(pose, person, person.time_ns))
    contact = contact_report(states)
    person_palm = np.array([person.palm.position for person in people])
    palm = np.array([state.palm.position for state in states])
    kinematics = skeleton.forward_kinematics(root, np.array([pose.quaternions for pose in generated]))
    generated_palm = right_palm(skeleton, *kinematics)[0]
    count = len(poses)
    contact_time = np.nan if contact.met_time_ns is None else 1e-9 * contact.met_time_ns
    return TrialResult(
        number=number,
        title=f"simulated person, {emotion}, cell {cell}",
        emotion=emotion,
        style=emotion,
        cell=cell,
        simulated=True,
        notes=(),
        contact=contact,
        error=contact.distance,
        uncorrected_error=float(np.linalg.norm(generated_palm - person_palm, axis=-1).min()),
        true_error=contact.distance,
        touch_error=contact.distance if contact.met else float("nan"),
        touch_speed=contact.approach_speed if contact.met else float("nan"),
        palm_angle=contact.palm_angle,
        out_of_reach=away > 0.0,
        why_not_met="" if contact.met else "the person's hand was out of the avatar's reach",
        contact_time=contact_time,
        time_error=contact_time - trial.contact_frame / RATE_HZ,
        other_error=float("nan"),
        speed_change=2.0,
        uncorrected_speed_change=4.0,
        markers_seen=0.75,
        times=np.arange(count) / RATE_HZ,
        people=people,
        poses=tuple(poses),
        generated=tuple(generated),
        person_palm=person_palm,
        palm=palm,
        generated_palm=generated_palm,
        other_palm=palm,
        weight=np.clip(1.0 - np.abs(np.arange(count) - trial.contact_frame) / 60.0, 0.0, 1.0),
        expected=(trial.contact_frame - np.arange(count)) / RATE_HZ,
        markers=markers,
        forecasts=tuple(
            ContactForecast(palm[trial.contact_frame], (trial.contact_frame - i) / RATE_HZ, 1e-4 * np.eye(4))
            if 0 < trial.contact_frame - i < 60
            else None
            for i in range(count)
        ),
        tick_ms=rng.gamma(8.0, 0.08, count),
    )


def _people(trial: PairTrial) -> tuple[tuple[HumanArm, ...], tuple[TrackedMarkers, ...]]:
    marker_set = load_marker_set(PERSON_SET)
    estimate = HumanArmEstimator(marker_set)
    positions = markers_of(trial.person, marker_set)
    velocities = np.gradient(positions, 1.0 / RATE_HZ, axis=0)
    count = positions.shape[1]
    fixed = np.zeros((count, 3, 3)), np.ones(count, bool), np.zeros(count, np.int64), np.ones(count, bool)
    markers = tuple(
        TrackedMarkers(marker_set.names, p, v, *fixed, ~fixed[1], round(1e9 * i / RATE_HZ))
        for i, (p, v) in enumerate(zip(positions, velocities, strict=True))
    )
    return tuple(map(estimate, markers)), markers


def _perturbed(trial: PairTrial, rng: np.random.Generator) -> np.ndarray:
    """The avatar actor's joint rotations with the right arm a few degrees off, more so as the palms meet."""
    skeleton = trial.avatar.skeleton
    hinges = skeleton.to_hinges(trial.avatar.quaternions)
    near = np.exp(-((np.arange(len(hinges)) - trial.contact_frame) ** 2) / 60.0**2)
    for name in ("right_shoulder", "right_elbow", "right_wrist"):
        hinges[:, skeleton.index(name)] += near[:, None] * rng.normal(0.0, 0.06, 3)
    return skeleton.from_hinges(skeleton.clamp(hinges))


@cache
def some_results() -> tuple[TrialResult, ...]:
    """One trial an emotion in the middle of the grid, and a happy one out of reach."""
    scene = build_scene()
    trials = [simulated_result(scene, number, emotion, "B2") for number, emotion in enumerate(EMOTIONS)]
    return (*trials, simulated_result(scene, len(trials), "happy", "C3", away=0.15))
