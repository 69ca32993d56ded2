"""What the trackers are compared on: a simulated arm, simulated high fives, and a real recording, all with gaps.

Markers are hidden for 300 ms at a time; where they really were is known, because they were there and were left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from highfive.calibration.personal_set import SPREAD, on_body, personal_set
from highfive.calibration.subject import fit_subject
from highfive.hil.bench.tracking_baseline_models import PeerModel, peer_model, start_of
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.people.grid import CELLS
from highfive.mocap_bridge.files.recording import resample
from highfive.mocap_bridge.frames import MarkerFrame
from highfive.mocap_bridge.markers.marker_set import MarkerSet
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.markers.one_person import read_person
from highfive.mocap_bridge.tracking.chain import make_chain, segment_order
from highfive.mocap_bridge.tracking.first_pose import first_state
from highfive.model.errors import HighFiveError
from highfive.model.geometry.rotations import Array

RATE_HZ = 120.0
NOISE = 0.001
"""Standard deviation of a simulated measurement, per coordinate, m."""

HIDDEN_FRAMES = 36
"""300 ms."""

ARM_COORDINATES = ("shoulder y", "shoulder x", "shoulder z", "elbow y", "elbow z", "wrist x", "wrist y")
"""The seven joints of the simulated arm, in the order of its coordinates."""

_FIRST, _PERIOD, _REAL_PERIOD = 60, 72, 90  # frames: of the first gap, and from one gap to the next
_BELOW = ("hip", "knee", "ankle", "toe")


@dataclass(frozen=True)
class Case:
    """T frames of one person, M markers.

    Attributes:
        marker_set: the set as it comes with the project.
        personal: the same on the person's own body.
        truth: (T, M, 3) m.
        measured: (T, M, 3) m.
        seen: (T, M) what the trackers are given.
        hidden: (T, M) what was left out, and is compared.
        peer: the model that the peers are given.
        start: (n,) coordinates of that model in the first frame.
        coordinates: (T, n) the true ones, where they are known.
    """

    marker_set: MarkerSet
    personal: MarkerSet
    truth: Array
    measured: Array
    seen: NDArray[np.bool_]
    hidden: NDArray[np.bool_]
    peer: PeerModel
    start: Array
    coordinates: Array | None = None

    def without_gaps(self) -> Case:
        """The same with nothing left out."""
        return replace(self, seen=self.seen | self.hidden, hidden=np.zeros_like(self.hidden))

    def frames(self) -> Iterator[MarkerFrame]:
        """What a tracker is given, frame by frame."""
        return frames_of(self.marker_set.names, self.measured, self.seen)


def frames_of(names: tuple[str, ...], points: Array, seen: NDArray[np.bool_]) -> Iterator[MarkerFrame]:
    """Frames at 120 Hz of points (T, M, 3), m, of which some are ``seen`` (T, M)."""
    none = np.zeros((0, 3))
    for k in range(len(points)):
        yield MarkerFrame(names, points[k], seen[k], k, round(k * 1e9 / RATE_HZ), 0, none)


def gaps(frames: int, markers: int, groups: Sequence[NDArray[np.intp]], period: int = _PERIOD) -> NDArray[np.bool_]:
    """Mask (T, M) of what is hidden: one group of markers after the other, 300 ms at a time."""
    hidden = np.zeros((frames, markers), dtype=bool)
    for number, start in enumerate(range(_FIRST, frames - HIDDEN_FRAMES, period)):
        hidden[start : start + HIDDEN_FRAMES, groups[number % len(groups)]] = True
    return hidden


def simulated_arm(seed: int, frames: int) -> Case:
    """An arm of seven joints that sway as sums of two sines, on a body that stands still.

    The eleven arm markers of the paper's set, its five head markers, and 1 mm of noise.
    """
    rng = np.random.default_rng([seed, 0])
    paper, skeleton, time = load_marker_set("paper"), avatar_skeleton(), np.arange(frames) / RATE_HZ

    def sway(size: float) -> Array:
        rate, phase = rng.uniform(0.3, 0.9, size=2), rng.uniform(0.0, 2.0 * np.pi, size=2)
        slow, quick = np.sin(2.0 * np.pi * rate[:, None] * time + phase[:, None])
        return size * (0.7 * slow + 0.3 * quick)

    coordinates = np.stack(
        [-0.9 + sway(0.7), -0.2 + sway(0.4), sway(0.5), -0.9 + sway(0.6), sway(0.7), sway(0.35), sway(0.175)], axis=1
    )
    angles = np.zeros((frames, len(skeleton), 3))  # hinges y, x, z
    angles[:, skeleton.index("right_shoulder")] = coordinates[:, :3]
    angles[:, skeleton.index("right_elbow")] = coordinates[:, [3, 3, 4]] * [1.0, 0.0, 1.0]
    angles[:, skeleton.index("right_wrist"), :2] = coordinates[:, 5:]
    root = np.tile(skeleton.offsets[0], (frames, 1))
    truth = paper.simulate(skeleton, *skeleton.forward_kinematics(root, skeleton.from_hinges(angles)))
    arm = [name for name, joint in zip(paper.names, paper.joints, strict=True) if joint != "head"]
    peer = peer_model(paper, arm, fixed=["right_clavicle"], rigid=["right_elbow.x"])
    personal = on_body(paper, skeleton, np.full(len(paper), SPREAD))
    return _with_gaps(paper, personal, truth, rng, peer, coordinates[0], coordinates)


def simulated_high_five(seed: int) -> Case:
    """A simulated person of some size who raises a hand to a high five; the paper's set and 1 mm of noise.

    The peers are given the person's own body, with a shoulder girdle that moves freely.
    """
    from highfive.hil.sim.people.actors import simulate_pair  # noqa: PLC0415  (it loads MuJoCo)
    from highfive.hil.sim.people.emotions import EMOTIONS  # noqa: PLC0415

    rng = np.random.default_rng([seed, 1])
    emotion, cell = list(EMOTIONS)[seed % len(EMOTIONS)], CELLS[seed % len(CELLS)]
    person, paper = simulate_pair(emotion, cell, 0, rng).person, load_marker_set("paper")
    truth = paper.simulate(
        person.skeleton, *person.skeleton.forward_kinematics(person.root_in_world, person.quaternions)
    )
    personal = on_body(paper, person.skeleton, np.full(len(paper), SPREAD))
    arm = [name for name, joint in zip(paper.names, paper.joints, strict=True) if joint != "head"]
    peer = peer_model(personal, arm)
    return _with_gaps(paper, personal, truth, rng, peer, _start(peer, personal, truth[0]), None)


def real_recording(path: Path, person: str | None = None, frames: int | None = None) -> Case:
    """Head, trunk and right arm of a recorded person, with wrist and hand hidden, from where all are seen.

    The person's body is fitted to the same recording, without what is hidden.

    Raises:
        HighFiveError: the file is not usable, or it never shows all markers at once.
    """
    one = read_person(path, person, None)
    recording, whole = resample(one.recording, RATE_HZ), one.marker_set
    kept = [
        name
        for name, joint in zip(whole.names, whole.joints, strict=True)
        if not joint.startswith("left_") and joint.rpartition("_")[2] not in _BELOW and name not in one.missing
    ]
    points, valid = whole.arrange(recording.names, recording.points, recording.valid)
    columns = whole.indices(kept)
    whole_frames = np.flatnonzero(valid[:, columns].all(axis=1))
    if not len(whole_frames):
        raise HighFiveError(f"{path}: no frame shows all of {', '.join(kept)}, with which the peers begin")
    shown = slice(int(whole_frames[0]), None if frames is None else int(whole_frames[0]) + frames)
    points, valid = points[shown], valid[shown]
    hand = whole.indices((*whole.arm.wrist, *whole.arm.hand))
    hidden = gaps(len(points), len(whole), [hand], _REAL_PERIOD) & valid
    if not hidden.any():
        raise HighFiveError(f"{path}: {len(points) / RATE_HZ:.1f} s from the first whole frame are too short for a gap")
    subject = fit_subject(avatar_skeleton(), whole, points, valid & ~hidden)
    personal, shipped = personal_set(subject, whole.name, whole.description).subset(kept), whole.subset(kept)
    points, valid, hidden = points[:, columns], valid[:, columns], hidden[:, columns]
    peer = peer_model(personal, kept)
    start = _start(peer, personal, points[0])
    return Case(shipped, personal, points, points, valid & ~hidden, hidden, peer, start)


def _with_gaps(
    paper: MarkerSet,
    personal: MarkerSet,
    truth: Array,
    rng: np.random.Generator,
    peer: PeerModel,
    start: Array,
    coordinates: Array | None,
) -> Case:
    measured = truth + rng.normal(scale=NOISE, size=truth.shape)
    hidden = gaps(len(truth), len(paper), [paper.indices(["RFIN", "RMC5"]), paper.indices(["RWRA", "RWRB"])])
    return Case(paper, personal, truth, measured, ~hidden, hidden, peer, start, coordinates)


def _start(peer: PeerModel, personal: MarkerSet, points: Array) -> Array:
    """Coordinates of the peers' model in a frame of which every marker is there: as our own tracker begins."""
    chain = make_chain(personal)
    state = first_state(chain, lifting(personal), points, np.ones(len(points), dtype=bool))
    if state is None:
        raise HighFiveError("the first frame shows too few markers to begin with")
    return start_of(peer, personal, state.pose.centres, state.pose.frames, state.pose.angles)


def lifting(marker_set: MarkerSet) -> NDArray[np.intp]:
    """The freedoms of a set's chain that lift its arms, as the tracker's first pose wants them."""
    chain, order = make_chain(marker_set), segment_order(marker_set)
    shoulders = [j for j, name in enumerate(order) if name.endswith("shoulder") and chain.parents[j] >= 0]
    return chain.first[shoulders].astype(np.intp)
