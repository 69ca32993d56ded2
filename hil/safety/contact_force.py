"""How hard a contact may be: the two-body model of ISO/TS 15066, annex A."""

from __future__ import annotations

import math


def contact_force(speed: float, body_mass: float, robot_mass: float, stiffness: float) -> float:
    """Largest force of a free contact, N: F = v √(μ k), 1/μ = 1/m_body + 1/m_robot.

    Two bodies meet with the relative ``speed``, m/s; all their energy of relative motion goes into a spring.

    Args:
        speed: m/s, relative.
        body_mass: kg, effective mass of the part of the body that is met.
        robot_mass: kg, effective mass of the arm: half its moving mass, and the payload.
        stiffness: N/m, of that part of the body.
    """
    return speed * math.sqrt(stiffness / (1.0 / body_mass + 1.0 / robot_mass))


def contact_speed(force: float, body_mass: float, robot_mass: float, stiffness: float) -> float:
    """Largest relative speed, m/s, at which a contact stays below ``force``, N; see :func:`contact_force`."""
    return force / contact_force(1.0, body_mass, robot_mass, stiffness)
