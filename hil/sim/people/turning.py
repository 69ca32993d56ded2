"""A simulated actor who is tapped on the shoulder and turns round, neutral, fearful or angry.

Simulated, and to be called so wherever it is shown. Nobody turned round in the recordings that this project knows; the
figures are set by hand after descriptions of posture (Wallbott 1998; Roether et al. 2009: fear draws back, raises the
shoulders and bends the arms, anger leans forward, fast, with stiff arms) and were seen by nobody. The feet do not step:
the whole body turns over them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.limb_ik import solve_leg
from highfive.hil.sim.people.role import RATE_HZ, TRUNK, ActorMotion, draw_individual
from highfive.hil.sim.profiles import minimum_jerk
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations
from highfive.model.geometry.rotations import Array

BEHIND = 172.0
"""°, of the turn: a half circle is where a hinge's angle ends."""
END_S = 1.2
"""So long the actor goes on standing, facing who tapped, s."""
_FINGERS = tuple(f"{finger}_{n}" for finger in ("index", "middle", "ring", "little") for n in (1, 2, 3))


@dataclass(frozen=True)
class TurnStyle:
    """How one emotion turns round: three times, s, and the posture at the end, in degrees and m."""

    waits: float
    """From the tap until the body turns."""
    turns: float
    """The turn itself."""
    head_leads: float
    """By so much the head turns before the body."""
    away: float
    """Drawn back from who tapped; negative: towards her."""
    crouch: float
    """How much lower the pelvis is."""
    trunk: float
    """Forward bend of the trunk."""
    head: float
    """Head bowed (positive) or lifted."""
    shoulders: float
    """Elevation of the clavicles."""
    arms: float
    """Both upper arms raised forward."""
    arms_out: float
    """Both upper arms away from the body."""
    elbows: float
    """Elbow flexion."""
    fingers: float
    """Curl of the fingers."""


TURNS: dict[str, TurnStyle] = {
    "neutral": TurnStyle(0.35, 1.20, 0.20, 0.12, 0.00, 0, 0, 0, 4, 6, 14, 18),
    "fearful": TurnStyle(0.12, 0.60, 0.06, 0.26, 0.05, -6, 8, 13, 38, 12, 95, 30),
    "angry": TurnStyle(0.18, 0.52, 0.04, 0.08, 0.01, 12, 4, 9, 12, 20, 48, 65),
}
"""The three styles of the source study, by name. All draw back: who taps a shoulder stands so near that a face would
fill her view, and an angry one, which leans forward, be inside of her."""
_BEFORE = replace(TURNS["neutral"], away=0.0)
"""How the actor stands with the back to who taps, whatever the emotion: nothing is to be seen before the tap."""


def turning(style: str, rng: np.random.Generator) -> ActorMotion:
    """One clip, from the tap on: a turn by nearly half a circle, to either side, after which the actor faces +x.

    Every call differs as ``rng`` says.

    Raises:
        HighFiveError: an unknown style; it lists the known ones.
    """
    if style not in TURNS:
        raise HighFiveError(f"the simulated actor does not turn round {style!r}; there are {', '.join(TURNS)}")
    skeleton, who, base = avatar_skeleton(), draw_individual(rng), TURNS[style]
    scale = {one.name: float(np.exp(rng.normal(0.0, 0.10))) for one in fields(TurnStyle)}
    end = replace(base, **{name: getattr(base, name) * factor for name, factor in scale.items()})
    times = np.arange(round((end.waits + end.turns + END_S) * RATE_HZ) + 1) / RATE_HZ
    body, head = _share(times, end.waits, end.turns), _share(times, end.waits - end.head_leads, 0.8 * end.turns)
    left = float(rng.choice([-1.0, 1.0]))
    angles = (1.0 - body)[:, None, None] * _posture(_BEFORE) + body[:, None, None] * _posture(end)
    angles = angles + who.posture + _sway(who.sway_amplitude, who.sway_frequency, who.sway_phase, times)
    angles[:, skeleton.index("pelvis"), 0] += np.radians(left * BEHIND * (1.0 - body))
    # The head, and the neck below it, are ahead of the body by what their joints allow.
    ahead = np.clip(-left * BEHIND * (head - body), -70.0, 70.0)
    for name, part in (("neck", 0.4), ("head", 0.6)):
        angles[:, skeleton.index(name), 2] += np.radians(part * ahead)
    away = np.stack([-end.away * body, np.zeros(len(times)), -end.crouch * body - 0.012], axis=-1)
    root = skeleton.offsets[0] + away
    _stand(angles, root)
    return ActorMotion(skeleton, root, skeleton.from_hinges(skeleton.clamp(angles)))


def _share(times: Array, begins: float, lasts: float) -> Array:
    """(T,), 0 before and 1 after, minimum jerk between."""
    return minimum_jerk((times - begins) / lasts)


def _posture(style: TurnStyle) -> Array:
    """Hinge angles (53, 3), rad, with the legs straight."""
    skeleton, degrees = avatar_skeleton(), np.zeros((len(avatar_skeleton()), 3))
    for name in TRUNK:
        degrees[skeleton.index(name), 0] = style.trunk / len(TRUNK)
    degrees[skeleton.index("neck"), 0] = 0.4 * style.head
    degrees[skeleton.index("head"), 0] = 0.6 * style.head - 0.5 * style.trunk
    for side, sign in (("right", -1.0), ("left", 1.0)):
        degrees[skeleton.index(f"{side}_clavicle")] = (0.0, sign * style.shoulders, 0.0)
        degrees[skeleton.index(f"{side}_shoulder")] = (-style.arms, sign * style.arms_out, 0.0)
        degrees[skeleton.index(f"{side}_elbow")] = (-style.elbows, 0.0, -sign * 15.0)
        for finger in _FINGERS:
            degrees[skeleton.index(f"{side}_{finger}"), 0] = -sign * style.fingers
        degrees[skeleton.index(f"{side}_thumb_2"), 0] = -sign * 0.4 * style.fingers
    return np.radians(degrees)


def _sway(amplitude: Array, frequency: Array, phase: Array, times: Array) -> Array:
    """Slow involuntary movement (T, 53, 3), rad."""
    return (amplitude * np.sin(2 * np.pi * frequency * times[:, None, None, None] + phase)).sum(axis=1)


def _stand(angles: Array, root: Array) -> None:
    """Bends the legs so that the soles stay on the floor, under the body as it turns."""
    skeleton = avatar_skeleton()
    # In a frame that turns with the body: the feet do, too.
    tilt = rotations.from_euler(skeleton.hinge_orders[0], angles[:, 0] * [0.0, 1.0, 1.0])
    below = root * [0.0, 0.0, 1.0]
    for side in ("right", "left"):
        names = ("pelvis", f"{side}_hip", f"{side}_knee", f"{side}_ankle")
        ankle = np.sum([skeleton.offsets[skeleton.index(name)] for name in names], axis=0)
        leg = [skeleton.index(f"{side}_{name}") for name in ("hip", "knee", "ankle")]
        angles[:, leg] = solve_leg(skeleton, side, (below, tilt), ankle)
