"""What people raise a hand for, beside a high five: key poses of the right hand, set by hand.

In the person's own frame: pelvis over the origin, facing +x, the right hand at negative y.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from highfive.model.geometry.rotations import Array

FORWARD, LEFT, UP = np.eye(3)


@dataclass(frozen=True)
class Landmarks:
    """Of a standing body: right shoulder and centre of the head (3,), m, length of the arm, m, and size (1: avatar)."""

    shoulder: Array
    head: Array
    arm: float
    size: float


@dataclass(frozen=True)
class Hand:
    """A palm (3,), m, its normal and its fingers' direction (3,), and the elbow's swivel outwards, rad."""

    palm: Array
    normal: Array
    fingers: Array
    elbow_out: float


@dataclass(frozen=True)
class Plan:
    """A gesture's course.

    Attributes:
        hands: one after the other; the first is where the hand is raised to.
        waits: s, before it goes on from the first.
        holds: s, before it goes down from the last.
        pace: of the raise, times the emotion's.
        strokes_quicker: how much faster it goes between the hands.
    """

    hands: tuple[Hand, ...]
    waits: float = 0.0
    holds: float = 0.0
    pace: float = 1.0
    strokes_quicker: float = 1.0


Gesture = Callable[[Landmarks, np.random.Generator], Plan]


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)


def _hand(palm: Array, normal: Array, fingers: Array, elbow_out: float, rng: np.random.Generator) -> Hand:
    """With a hand that is turned a little otherwise each time."""
    normal = _unit(normal + rng.normal(0.0, 0.12, 3))
    fingers = fingers + rng.normal(0.0, 0.12, 3)
    return Hand(palm, normal, _unit(fingers - normal * (fingers @ normal)), np.radians(elbow_out))


def _jitter(rng: np.random.Generator, *deviations: float) -> Array:
    return np.clip(rng.standard_normal(3), -2.0, 2.0) * deviations


def _wave(body: Landmarks, rng: np.random.Generator) -> Plan:
    middle = body.shoulder + body.size * (np.array([0.20, -0.12, 0.25]) + _jitter(rng, 0.06, 0.06, 0.09))
    swing, elbow = body.size * rng.uniform(0.05, 0.16), rng.normal(35.0, 10.0)
    sides = [1.0, -1.0] * int(rng.integers(2, 5))
    hands = [_hand(middle + side * swing * LEFT, FORWARD, UP + 0.5 * side * LEFT, elbow, rng) for side in sides]
    return Plan(tuple(hands), holds=rng.uniform(0.0, 0.2), strokes_quicker=rng.uniform(1.0, 1.6))


def _stretch(body: Landmarks, rng: np.random.Generator) -> Plan:
    place = np.array([0.02, -0.10, 0.98 * body.arm / body.size]) + _jitter(rng, 0.06, 0.08, 0.04)
    palm = body.shoulder + body.size * place
    hands = (_hand(palm, UP + 0.5 * FORWARD, LEFT + 0.4 * UP, 50.0, rng), _hand(palm + 0.03 * UP, UP, LEFT, 50.0, rng))
    return Plan(hands, waits=rng.uniform(0.0, 0.3), holds=rng.uniform(0.4, 1.2), pace=rng.uniform(0.6, 1.0))


def _point(body: Landmarks, rng: np.random.Generator) -> Plan:
    aside, above = np.radians(rng.uniform(-70.0, 45.0)), np.radians(rng.uniform(-25.0, 40.0))
    towards = np.array([np.cos(aside) * np.cos(above), np.sin(aside) * np.cos(above), np.sin(above)])
    palm = body.shoulder + body.arm * rng.uniform(0.75, 1.0) * towards
    hand = _hand(palm, LEFT - UP * rng.uniform(0.0, 1.5), towards, rng.normal(20.0, 10.0), rng)
    return Plan((hand,), holds=rng.uniform(0.3, 1.3))


def _strokes(place: Array, along: Array, count: int, hand: Callable[[Array], Hand]) -> tuple[Hand, ...]:
    return tuple(hand(place + (along if number % 2 else -along)) for number in range(count))


def _scratch(body: Landmarks, rng: np.random.Generator) -> Plan:
    """The head: its side, top or back."""
    outward = _unit(np.array([rng.uniform(-0.8, 0.4), rng.uniform(-1.0, -0.2), rng.uniform(0.4, 1.2)]))
    place = body.head + body.size * 0.13 * outward
    along = body.size * rng.uniform(0.01, 0.03) * _unit(np.cross(outward, FORWARD + rng.normal(0.0, 0.3, 3)))
    elbow, count = rng.normal(55.0, 12.0), int(rng.integers(3, 9))
    hands = _strokes(place, along, count, lambda at: _hand(at, -outward, UP + LEFT - 0.3 * FORWARD, elbow, rng))
    return Plan(hands, holds=rng.uniform(0.0, 0.3), strokes_quicker=0.5)


def _hair(body: Landmarks, rng: np.random.Generator) -> Plan:
    """Runs through it from the forehead to the back."""
    front = body.head + body.size * (np.array([0.12, -0.05, 0.08]) + _jitter(rng, 0.015, 0.03, 0.02))
    top = body.head + body.size * (np.array([0.0, -0.06, 0.15]) + _jitter(rng, 0.02, 0.02, 0.01))
    back = body.head + body.size * (np.array([-0.10, -0.08, 0.08]) + _jitter(rng, 0.02, 0.02, 0.02))
    elbow = rng.normal(60.0, 12.0)
    hands = [_hand(at, body.head - at, UP + LEFT - 0.5 * FORWARD, elbow, rng) for at in (front, top, back)]
    return Plan(tuple(hands), holds=rng.uniform(0.0, 0.2), strokes_quicker=0.7)


def _glasses(body: Landmarks, rng: np.random.Generator) -> Plan:
    place = body.head + body.size * (np.array([0.15, -0.06, -0.02]) + _jitter(rng, 0.015, 0.03, 0.02))
    elbow, count = rng.normal(35.0, 12.0), int(rng.integers(1, 4))
    along = body.size * np.array([0.01, 0.0, 0.015])
    hands = _strokes(place, along, count, lambda at: _hand(at, LEFT - 0.8 * FORWARD, UP + 0.3 * LEFT, elbow, rng))
    return Plan(hands, holds=rng.uniform(0.1, 0.6), strokes_quicker=0.5)


def _watch(body: Landmarks, rng: np.random.Generator) -> Plan:
    place = body.shoulder + body.size * (np.array([0.28, 0.16, -0.20]) + _jitter(rng, 0.04, 0.05, 0.06))
    hand = _hand(place, -UP - 0.3 * FORWARD, LEFT + 0.2 * FORWARD, rng.normal(35.0, 10.0), rng)
    return Plan((hand,), holds=rng.uniform(0.5, 1.3))


def _speak(body: Landmarks, rng: np.random.Generator) -> Plan:
    """Asks for the floor: the hand goes up beside the head and stays."""
    height = rng.uniform(0.20, 0.92 * body.arm / body.size)
    palm = body.shoulder + body.size * (np.array([0.12, -0.06, height]) + _jitter(rng, 0.04, 0.04, 0.0))
    hand = _hand(palm, FORWARD + rng.uniform(-0.3, 0.8) * LEFT, UP, rng.normal(25.0, 12.0), rng)
    return Plan((hand,), holds=rng.uniform(0.5, 1.8))


def _hip(body: Landmarks, rng: np.random.Generator) -> Plan:
    place = body.shoulder + body.size * (np.array([0.04, -0.03, -0.40]) + _jitter(rng, 0.03, 0.02, 0.03))
    hand = _hand(place, LEFT, FORWARD - 0.5 * UP, rng.normal(70.0, 10.0), rng)
    return Plan((hand,), holds=rng.uniform(0.5, 1.8), pace=rng.uniform(0.6, 1.0))


def _aside(body: Landmarks, rng: np.random.Generator) -> Plan:
    """Reaches for something beside the person."""
    aside, above = np.radians(rng.uniform(-115.0, -45.0)), np.radians(rng.uniform(-40.0, 35.0))
    towards = np.array([np.cos(aside) * np.cos(above), np.sin(aside) * np.cos(above), np.sin(above)])
    palm = body.shoulder + body.arm * rng.uniform(0.7, 1.0) * towards
    hand = _hand(palm, LEFT - rng.uniform(0.0, 1.0) * UP, towards, rng.normal(20.0, 10.0), rng)
    return Plan((hand,), holds=rng.uniform(0.1, 0.8))


GESTURES: dict[str, Gesture] = {
    "wave": _wave,
    "stretch": _stretch,
    "point": _point,
    "scratch": _scratch,
    "hair": _hair,
    "glasses": _glasses,
    "watch": _watch,
    "speak": _speak,
    "hip": _hip,
    "aside": _aside,
}
"""Gestures by name."""
