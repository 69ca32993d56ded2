"""What can be tuned in the plan of the servo arm."""

from __future__ import annotations

from dataclasses import dataclass

from highfive.model.settings import Settings, named_tuple, setting


@dataclass(frozen=True)
class RetargetSettings(Settings):
    """How the arm's plan meets a hand.

    Chosen on simulated high fives of seeds 1 to 3, what concerns hurry, waiting and facing later on the 36 of seed 0
    (docs/arm.md), unless a field names another source. In a session lag, sag and the speeds come from the arm that is
    there and its limits.
    """

    tick: float = setting(1.0 / 120.0, "s", above=0.0)
    """Of the session."""
    lag: float = setting(0.03, "s", least=0.0)
    """The arm is where it was commanded to be so long ago: about what servos of this class lag."""
    sag: tuple[float, ...] = setting((), "rad/(N·m)", least=0.0)
    """How much each joint gives way to a torque; the command goes beyond by that. Empty: 0."""
    contact_speed: float = setting(0.78, "m/s", above=0.0)
    """Largest speed of the plate relative to the hand that it meets (ISO/TS 15066 by a two-body model:
    docs/safety.md)."""
    face_speed: float = setting(0.22, "m/s", above=0.0)
    """Largest speed of the plate near the head (likewise), ..."""
    face_radius: float = setting(0.30, "m", least=0.0)
    """... which is so near its centre (head, plate, and what the tracker may err by), ..."""
    face_braking: float = setting(4.0, "m/s²", above=0.0)
    """... and what it can lose of more on the way there: by hand."""
    head_radius: float = setting(0.14, "m", least=0.0)
    """No part of the arm plans to come nearer the head's centre than this and a margin: by hand."""
    care: float = setting(0.8, above=0.0, most=1.0)
    """Share of those speeds that is planned for at contact: what is measured is late and noisy."""
    sharpness: float = setting(0.002, "m", above=0.0)
    """Deviation of the place of contact that the plan does not tell from none."""
    loose: float = setting(0.08, "m", above=0.0)
    """Deviation from the scaled path that costs as much as one standard deviation of the place of contact."""
    leisurely: float = setting(0.3, "m/s", above=0.0)
    """Where the plate has to be faster than this on average it hurries, and the path counts less."""
    turned: float = setting(0.15, "rad", above=0.0)
    """The same for the direction in which the plate faces at contact, ..."""
    turning: float = setting(1.5, "rad/s", least=0.0)
    """... which is surer by this for each second nearer: a hand on its way faces elsewhere."""
    facing: float = setting(0.3, "s", above=0.0)
    """Time before contact within which the plate turns from where it faces when it waits to the person's palm."""
    rounds: int = setting(1, least=1)
    """Improvements of the plan per tick: the next one goes on from there (real-time iteration, Diehl et al. 2005).
    They bound the cost of a tick."""
    back: float = setting(0.15, "m", least=0.0)
    below: float = setting(0.08, "m", least=0.0)
    """A plate that waits for one of several hands is so far behind and below where they go: a hand comes from there,
    and a plate that is in front of it may hardly move. Simulated happy and angry high fives of seeds 1 to 6."""
    waits: float = setting(20.0, "1/rad²", least=0.0)
    """How much that posture counts."""
    effort: float = setting(3e-5, least=0.0)
    """Cost of a joint acceleration of 1 rad/s² at a knot."""
    memory: float = setting(0.25, "s", least=0.0)
    """A contact that nobody speaks of any more is expected for this long, ..."""
    forgetting: float = setting(0.3, "m/s", least=0.0)
    """... less surely by this."""
    longest_delay: float = setting(0.3, "s", least=0.0)
    """A hand that could not be met in time is followed at most so long."""
    touch: float = setting(0.06, "s", least=0.0)
    """The plate stays with a hand that it has met so long."""
    near: float = setting(0.10, "m", least=0.0)
    waiting: float = setting(0.15, "m/s", least=0.0)
    """A hand that could not be met in time is followed only if it is this near and no faster than this."""
    press: float = setting(0.04, "s", least=0.0)
    most_press: float = setting(0.02, "m", least=0.0)
    """The plate aims so far through the hand as the two close in this time, but no further than this, and so far
    once it is late: a hand that is not met goes back, and the contact is then missed altogether."""
    slowest: float = setting(0.35, "m/s", least=0.0)
    """The plate comes at least this fast: slower ones are early by what the hand's place is not known, and are not
    where a hand that goes back a moment sooner was."""
    calm: float = setting(0.03, least=0.0)
    """Cost of a joint speed of 1 rad/s at a knot."""
    met: float = setting(0.004, "m", least=0.0)
    """A commanded plate this near the place of contact is there."""
    settle: float = setting(0.15, "s", least=0.0)
    """So long before contact the plate is in front of the hand, ..."""
    beforehand: float = setting(0.25, "s", least=0.0)
    """... where it has to hurry up to so much longer: a fast hand is near before contact, and near it the plate may
    hardly move, ..."""
    standoff: float = setting(0.02, "m", least=0.0)
    """... this far away, and goes with it: neither the place nor the time of contact is known well before, but where
    the hand is is, and near it the plate may not make up for what is missing."""
    yielding: float = setting(0.93, above=0.0, most=1.0)
    """Share of the largest speed relative to the hand that is planned for on the way."""
    shortest_knot: float = setting(0.015, "s", above=0.0)
    """The plan's knots are no nearer each other than this and ..."""
    longest_knot: float = setting(0.07, "s", above=0.0)
    """... no further apart than this."""


@dataclass(frozen=True)
class PlanSettings(Settings):
    """Margins of the optimal control and how far it goes. Its compiled form is part of each task.

    Set by hand on the high fives on which :class:`RetargetSettings` was chosen.
    """

    stop_margin: float = setting(0.06, "rad", least=0.0)
    """Before a joint's stop, from which on nearness to it costs."""
    speed_fraction: float = setting(0.93, above=0.0, most=1.0)
    """Of a joint's largest speed, beyond which speed costs."""
    gap_margin: float = setting(0.05, "m", least=0.0)
    """Of a gap to arm, floor, mount or head, below which nearness costs."""
    hard_gap: float = setting(0.015, "m", least=0.0)
    """Of a gap, that no step goes below."""
    cap_distance: float = setting(0.15, "m", least=0.0)
    """From the hand, within which the largest closing speed holds."""
    touching: float = setting(0.03, "m", least=0.0)
    """Nearer than this the line from plate to hand is the desired normal."""
    face_border: float = setting(0.05, "m", above=0.0)
    """From the zone around a head, within which passing by counts the less."""
    waiting_distance: float = setting(0.05, "m", above=0.0)
    """A hand that is further than this from where it will be met is waited for this far before."""
    braking_fraction: float = setting(0.5, above=0.0, most=1.0)
    """Of a joint's acceleration, that is kept for stopping before a limit."""
    torque_rounds: int = setting(3, least=0)
    """Times that torques are looked at and what is too much is taken from the joint itself, before all are
    shortened."""
    guess_steps: int = setting(4, least=1)
    """Improvements per tick of the posture that meets the hand."""
    dampings: int = setting(3, least=1)
    """Tried for an improvement, the first one 0, the second ..."""
    first_damping: float = setting(0.1, "1/rad²", above=0.0)
    """... this fraction of the cost, ..."""
    more_damping: float = setting(30.0, above=1.0)
    """... the next this many times more; for each ..."""
    step_lengths: int = setting(2, least=1)
    """... so many fractions of the step, ..."""
    shortening: float = setting(0.35, above=0.0, below=1.0)
    """... each this times the one before."""
    converged: float = setting(1e-4, least=0.0)
    """Fraction of the cost; an improvement by less is the last of a tick."""


PlanSettingsValues = named_tuple(PlanSettings)


@dataclass(frozen=True)
class PlanWeights(Settings):
    """What the plan's costs weigh: squares in units of what is tolerated. Chosen as :class:`PlanSettings`.

    The defaults are compiled in. Passed at run time, the compiler orders the sums otherwise, and plans differ in their
    last bits; to try another weight, change its default.
    """

    stop_weight: float = setting(1e4, "1/rad²", least=0.0)
    """Of nearness to a joint's stop."""
    speed_weight: float = setting(300.0, "s²/rad²", least=0.0)
    """Of speed beyond a fraction of a joint's largest."""
    gap_weight: float = setting(1e4, "1/m²", least=0.0)
    """Of nearness to arm, floor, mount or head."""
    torque_weight: float = setting(0.3, "1/(N²·m²)", least=0.0)
    """Of torque beyond the torque–speed line."""
    cap_weight: float = setting(400.0, "s²/m²", least=0.0)
    """Of speed beyond what is allowed relative to the hand, and near a head."""
    cap_braking: float = setting(6.0, "m/s²", least=0.0)
    """A plate that is not yet near the hand may be faster, by what this takes off on the way there."""
    hand_fading: float = setting(0.1, "s", above=0.0)
    """In which a hand's velocity fades beyond the contact, and three times that before it."""
    meeting_weight: float = setting(5.0, "s²/m²", least=0.0)
    """Of the plate's velocity as it meets the hand."""
    normal_before: float = setting(0.05, least=0.0, most=1.0)
    """Fraction of the normal's weight that counts before."""
    place_fading: float = setting(0.15, "m/s", least=0.0)
    """By which the place in front of the hand is less strict for each s before the contact."""
    path_knot: float = setting(0.05, "s", above=0.0)
    """Of the path that count as one knot."""


PlanWeightsValues = named_tuple(PlanWeights)
WEIGHTS = PlanWeights().compiled()
"""The defaults, as compiled code reads them."""
