"""How far what the page draws lies from where it is: the page's own code (``motion.js``) on poses as they are sent."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from highfive.hil.session.session import Session
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.hil.sim.playout import KinematicPlayOut
from highfive.hil.sim.scene import Scene
from highfive.hil.trials.partners import simulated_partners
from highfive.hil.trials.trial import run_trial
from highfive.hil.view.browser import Browser
from highfive.hil.view.cast import Cast
from highfive.hil.view.player import PERIOD_NS, RATE_HZ, Player
from highfive.hil.view.recorded import RecordedTrial, placed_bodies
from highfive.hil.view.wire import PoseMessage
from highfive.model import DEFAULT_MODEL
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array
from highfive.model.hgpdm.store import load_model

HIGH_FIVES = 8
TICK_LATE_MS, SENT_LATE_MS = 3.0, 1.1
"""From a session's tick beginning, and from a recording's pose being due, until the page has the pose."""
PICTURE_MS = 1000.0 / 89.9
"""From picture to picture of a display of 90 Hz that drifts against the ticks, and so meets them at all phases."""
_BEGIN_S, _END_S = 0.1, 0.06
_PLAY = """(async (sent, pictures) => {
  const {Motion} = await import('/motion.js'), motion = new Motion();
  let next = 0;
  return pictures.map(([now, seen]) => {
    for (; next < sent.length && sent[next].arrives <= now; next++) {
      const {bodies, markers, ...more} = sent[next];
      motion.add({...more, bodies: new Float32Array(bodies), markers: new Float32Array(markers)});
    }
    return Array.from(motion.at(seen).bodies);
  });
})(%s, %s)"""


@dataclass(frozen=True)
class Motions:
    """A high five of T ticks as it is drawn: its style, s, and (T, B, 7) of bodies in the world."""

    style: str
    times: Float[np.ndarray, " T"]
    bodies: Float[np.ndarray, "T B 7"]


def drawn_bodies(
    browser: Browser, sent: Iterable[tuple[float, PoseMessage]], pictures: Sequence[tuple[float, float]]
) -> Float[np.ndarray, "P B 7"]:
    """Bodies in each picture.

    Args:
        browser: that has opened the page.
        sent: poses, each with when the page has it, ms.
        pictures: when each is made, and for when, ms; all after the first pose.
    """
    rows: list[dict[str, Any]] = [
        {
            "arrives": arrives, "holds": 1e-6 * one.holds_ns, "time": float(np.float32(one.time_s)), "rate": one.rate,
            "bodies": one.bodies.ravel().tolist(), "markers": one.markers.ravel().tolist(), "seen": one.seen.tolist(),
        }
        for arrives, one in sent
    ]  # fmt: skip
    found = browser.evaluate(_PLAY % (json.dumps(rows), json.dumps([list(one) for one in pictures])))
    return np.array(found).reshape(len(pictures), -1, 7)


def simulated_motions(scene: Scene, seed: int) -> list[Motions]:
    """High fives of simulated people in all styles, as a session plays them."""
    emotions = tuple(EMOTIONS)
    partners, model = simulated_partners(HIGH_FIVES, emotions, ("B2", "A3"), seed), load_model(DEFAULT_MODEL)
    found = []
    for number, partner in enumerate(partners):
        session = Session(model, {partner.emotion: 1.0}, partner.marker_set, scene)
        result = run_trial(number, partner, session, KinematicPlayOut(scene))
        bodies, _ = placed_bodies(scene, result.poses, result.people)
        found.append(Motions(partner.emotion, result.times - result.times[0], bodies))
    return found


def drawn_mm(
    browser: Browser, scene: Scene, motions: Sequence[Motions], *, recorded: bool
) -> dict[str, dict[str, float]]:
    """By style, for the avatar's palm and the person's: how far from where it is, mm, it is drawn in 95 % of pictures.

    Where it is as the picture is seen is interpolated between ticks by cubic splines.

    Args:
        browser: that has opened the page.
        scene: whose bodies they are.
        motions: high fives.
        recorded: sent as :class:`Player` sends a recording; else as a session does, each tick as it comes.
    """
    of = Cast.of(scene.model).description()["palms"]
    off: dict[str, list[Array]] = {}
    for motion in motions:
        bodies = motion.bodies[:, [of[who]["body"] for who in ("avatar", "person")]]
        small = replace(motion, bodies=bodies)
        made = 1e3 * np.arange(_BEGIN_S, motion.times[-1] - _END_S, 1e-3 * PICTURE_MS)
        seen = made + PICTURE_MS
        sent = _as_recorded(small) if recorded else _as_ticks(small)
        drawn = drawn_bodies(browser, sent, list(zip(made.tolist(), seen.tolist(), strict=True)))
        places = [np.array(of[who]["position"]) for who in ("avatar", "person")]
        true = CubicSpline(motion.times, _palms(bodies, places))(1e-3 * seen)
        off.setdefault(motion.style, []).append(1e3 * np.linalg.norm(_palms(drawn, places) - true, axis=-1))
    return {
        style: dict(
            zip(("avatar", "person"), np.percentile(np.concatenate(rows), 95, axis=0).round(2).tolist(), strict=True)
        )
        for style, rows in sorted(off.items())
    }


def _palms(bodies: Array, places: Sequence[Array]) -> Array:
    """(T, 2, 3) of the palms' ``places`` on the bodies (T, 2, 7)."""
    return bodies[..., :3] + np.stack(
        [
            rotations.rotate(bodies[:, i, 3:], np.broadcast_to(place, (len(bodies), 3)))
            for i, place in enumerate(places)
        ],
        axis=1,
    )


def _as_ticks(motion: Motions) -> list[tuple[float, PoseMessage]]:
    return [
        (1e3 * time + TICK_LATE_MS, _message(round(1e9 * time), float(time), bodies))
        for time, bodies in zip(motion.times, motion.bodies, strict=True)
    ]


def _as_recorded(motion: Motions) -> list[tuple[float, PoseMessage]]:
    count, none = len(motion.times), np.zeros(len(motion.times))
    trial = RecordedTrial(
        title="", style=motion.style, cell="", times=motion.times, bodies=motion.bodies,
        markers=np.zeros((count, 0, 3)), seen=np.zeros((count, 0), dtype=bool), weight=none, expected=none, palms=none,
        forecasts=(None,) * count, contact={},
    )  # fmt: skip
    player, sent = Player([trial]), list[tuple[float, PoseMessage]]()
    for due in range(0, round(1e9 * float(motion.times[-1])), PERIOD_NS):
        sent.append((1e-6 * due + SENT_LATE_MS, player.poses(due)))
        player.advance(1.0 / RATE_HZ)
    return sent


def _message(holds_ns: int, time_s: float, bodies: Array) -> PoseMessage:
    return PoseMessage(0, holds_ns, 0, 0, 1.0, time_s, bodies, np.zeros((0, 3)), np.zeros(0, dtype=bool))
