"""A model of somebody else's that stands in one pose, and misbehaves on demand."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from highfive import SimpleReaction, avatar_skeleton

CONTACT = np.array([0.5, -0.1, 1.35])


def standing(number: int) -> SimpleReaction:
    """The answer of tick ``number``: it stands, and expects contact at 1 s."""
    return SimpleReaction(np.zeros(159), np.array([0.0, 0.0, 0.93]), CONTACT, CONTACT, 1.0 - number / 120.0)


@dataclass
class Standing:
    """The model; ``answer`` gives the reaction of a tick."""

    answer: Callable[[int], Any] = standing
    emotions: tuple[str, ...] = ("neutral", "happy", "sad", "angry")
    skeleton_hash: str = field(default_factory=lambda: avatar_skeleton().hash)

    def rest(self, style: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.array([0.0, 0.0, 0.93]), np.zeros(159)

    def start(self, style: np.ndarray, rate_hz: float) -> StandingResponder:
        return StandingResponder(self.answer, style)


class StandingResponder:
    def __init__(self, answer: Callable[[int], Any], style: np.ndarray):
        self.answer, self.style, self.number = answer, style, 0

    def set_style(self, weights: np.ndarray) -> None:
        self.style = weights

    def reset(self) -> None:
        self.number = 0

    def step(self, hand_points: np.ndarray | None, covariance: np.ndarray | None = None) -> Any:
        self.number += 1
        return self.answer(self.number)


def misshapen(number: int) -> SimpleReaction:
    """One joint too many, from tick 20."""
    return standing(number) if number < 20 else replace(standing(number), joints=np.zeros(160))


def raises(number: int) -> SimpleReaction:
    """A mistake, from tick 20."""
    if number < 20:
        return standing(number)
    raise KeyError("elbow")


def sleeps(number: int) -> SimpleReaction:
    """Too long for a tick, from tick 20."""
    if number >= 20:
        time.sleep(0.7)
    return standing(number)
