"""A model of your own: nearest neighbours, in the same loop, report and table as the hierarchical model.

It answers with the mean of the recorded poses that followed the most similar hands. Play it, and score it:

    highfive capture --repetitions 2 --out out/captured
    highfive simulate --model examples/own_model/nearest_neighbours.py:fit --data out/captured --trials 4
    highfive evaluate out/captured --also examples/own_model/nearest_neighbours.py:fit
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from highfive import SimpleReaction, Trial, avatar_skeleton

PAST_S = (0.0, 0.1, 0.25)
"""How long ago the hand is looked at, s: now, and two earlier times that tell where it is going."""

NEIGHBOURS = 8
RATE_HZ = 60.0
"""Of the recorded frames that are kept."""


def fit(trials: Sequence[Trial]) -> NearestNeighbours:
    """Keeps the hands and the poses of all trials."""
    hands, poses, emotions, rests = [], [], [], []
    for trial in trials:
        step = max(1, round(trial.rate_hz / RATE_HZ))
        frames = np.arange(0, len(trial.joints), step)
        hand = trial.hand_points.reshape(len(trial.joints), 6)
        past = [hand[np.maximum(frames - round(ago * trial.rate_hz), 0)] for ago in PAST_S]
        until_contact = (trial.contact_frame - frames) / trial.rate_hz
        contact = np.broadcast_to(trial.palm[trial.contact_frame], (len(frames), 3))
        hands.append(np.hstack(past))
        poses.append(
            np.hstack([trial.joints[frames], trial.root[frames], trial.palm[frames], contact, until_contact[:, None]])
        )
        emotions += [trial.emotion] * len(frames)
        rests.append((trial.emotion, np.concatenate([trial.root[0], trial.joints[0]])))
    return NearestNeighbours(np.vstack(hands), np.vstack(poses), np.array(emotions), rests)


class NearestNeighbours:
    """The model: recorded hands (N, 18), m, the poses (N, D + 10) that went with them, and their emotions (N,).

    ``rests`` are the emotion, root and joints (3 + D,) with which each trial began.
    """

    def __init__(self, hands: np.ndarray, poses: np.ndarray, emotions: np.ndarray, rests: list[tuple[str, np.ndarray]]):
        """Builds a tree of the hands of each emotion."""
        self.emotions = tuple(sorted(set(emotions)))
        self.skeleton_hash = avatar_skeleton().hash
        self.poses = [poses[emotions == name] for name in self.emotions]
        self.trees = [KDTree(hands[emotions == name]) for name in self.emotions]
        self.rests = np.array([np.mean([rest for of, rest in rests if of == name], axis=0) for name in self.emotions])

    def rest(self, style: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Root and joints of the mean pose in which the recordings of the style begin."""
        rest = style @ self.rests
        return rest[:3], rest[3:]

    def start(self, style: np.ndarray, rate_hz: float) -> NeighbourResponder:
        """A responder at so many ticks per second."""
        return NeighbourResponder(self, style, rate_hz)


class NeighbourResponder:
    """The model at work."""

    def __init__(self, model: NearestNeighbours, style: np.ndarray, rate_hz: float):
        """Begins with nobody there."""
        self.model, self.style, self.back = model, style, [round(ago * rate_hz) for ago in PAST_S]
        self.reset()

    def set_style(self, weights: np.ndarray) -> None:
        """Takes (K,) style weights."""
        self.style = weights

    def reset(self) -> None:
        """Forgets the hand."""
        self.seen: deque[np.ndarray] = deque(maxlen=max(self.back) + 1)

    def step(self, hand_points: np.ndarray | None, covariance: np.ndarray | None = None) -> SimpleReaction:
        """The mean of the poses that went with the most similar hands; a hidden hand stays where it was."""
        if hand_points is not None:
            self.seen.append(np.reshape(hand_points, 6))
        if not self.seen:
            root, joints = self.model.rest(self.style)
            return SimpleReaction(joints, root, root, root, 1.0, in_distribution=False)
        now = len(self.seen) - 1
        query = np.concatenate([self.seen[max(now - back, 0)] for back in self.back])
        pose = sum(weight * self.mean(number, query) for number, weight in enumerate(self.style) if weight)
        joints, root, palm, contact, clock = np.split(pose, [-10, -7, -4, -1])
        return SimpleReaction(joints, root, palm, contact, float(clock[0]))

    def mean(self, number: int, query: np.ndarray) -> np.ndarray:
        """Mean pose of an emotion's nearest neighbours, nearer ones counting for more."""
        distances, neighbours = self.model.trees[number].query(query, NEIGHBOURS)
        weights = 1.0 / (distances + 0.01)
        return weights @ self.model.poses[number][neighbours] / weights.sum()
