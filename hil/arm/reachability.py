"""Where to mount the servo arm: which bases reach every cell of the high-five grid, with what margin and how fast.

For every base of a grid of heights, stand-offs, sides, tilts and plate distances the search solves for the posture of
each cell (palm facing the simulated person's), and rates it by the joints' distance from their limits, the gap to
mount, floor and arm itself, and the quickest reach from the ready posture inside speed and torque. Of those that reach
all nine cells it takes the one whose slowest reach is quickest; ``docs/decisions`` says what came out.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.planner_settings import RetargetSettings
from highfive.hil.arm.planner_values import ExpectedContact, PalmGoal
from highfive.hil.arm_model import dynamics
from highfive.hil.arm_model.arm_folder import ArmFolder, find_arm
from highfive.hil.arm_model.mount import Mount
from highfive.hil.arm_model.servo_arm import ServoArm, solve
from highfive.hil.sim.people.grid import CELLS, GRID_Y, GRID_Z
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry.rotations import Array
from highfive.model.settings import Settings, setting

SIX = 6
"""Joints that can give a plate any place and normal, with one to spare."""
UP = np.array([0.0, 0.0, 1.0])

DEPTH = 0.49
"""x of the plane in which simulated palms meet, m."""
FACING = np.radians(40.0)
"""Palms meet turned by so much to each one's left: straight on, forearms run into their limits."""
BACK = 0.16
"""The ready plate waits so far behind the plane of contact, m, ..."""
DOWN = 0.04
"""... and so much lower than the grid's middle."""


@dataclass(frozen=True)
class ReachabilitySettings(Settings):
    """What counts as reached, and which bases are tried. Set by hand (docs/decisions)."""

    near: float = setting(1e-3, "m", above=0.0)
    """A posture that misses by more does not reach."""
    margin: float = setting(float(np.radians(10.0)), "rad", least=0.0)
    """Least distance of a joint from its limit that counts as reached; forearm and wrist have turns to spare."""
    gap: float = setting(0.02, "m", least=0.0)
    """Least gap to floor, mount and the arm itself."""
    agile: float = setting(0.03, "m", least=0.0)
    """Least singular value of the plate's Jacobian (m, and 0.2 m per rad of normal): below, a joint must race."""
    aside: float = setting(float(np.radians(35.0)), "rad", least=0.0)
    """The waiting plate faces the person at least so well."""
    heights: tuple[float, ...] = setting((0.90, 1.00, 1.10, 1.20, 1.30), "m", above=0.0)
    standoffs: tuple[float, ...] = setting((0.40, 0.45, 0.50, 0.55, 0.60), "m", above=0.0)
    sides: tuple[float, ...] = setting((0.0, 10.0, 20.0), "°", above=-180.0, most=180.0)
    tilts: tuple[float, ...] = setting((0.0, 12.5, 25.0), "°", above=-90.0, below=90.0)
    plates: tuple[float, ...] = setting((0.10, 0.15, 0.20), "m", above=0.0)
    """Of the bases that are tried (:class:`Base`)."""
    finalists: int = setting(8, least=1)
    """Of the best bases, that get a better ready posture before one is chosen."""
    rounds: int = setting(200, least=1)
    """Postures that are tried for it."""
    near_fewer: float = setting(2e-3, "m", above=0.0)
    """Of an arm of fewer than six joints: position; the normal is met as far as it can be, ..."""
    turned_fewer: float = setting(float(np.radians(35.0)), "rad", above=0.0)
    """... and is to be off by less than this."""
    margin_fewer: float = setting(float(np.radians(6.0)), "rad", least=0.0)
    """Small arms reach few cells with more."""
    gap_fewer: float = setting(0.01, "m", least=0.0)
    """Their links are thinner."""
    starts: int = setting(24, least=1)
    """Postures from which each place is solved for."""


REACHABILITY = ReachabilitySettings()


@dataclass(frozen=True)
class Base:
    """A way to mount the arm.

    Attributes:
        height: m, of the base's underside.
        standoff: m, from the base's axis to the middle of the grid, along ``side``.
        side: degrees; the base stands behind the grid in this direction, and points along it.
        tilt: degrees, pitched forward.
        plate: m, from the last joint to the plate; None for what the arm's model says.
        folder: which arm; None for the default one.
        left: m, that the base stands to its left of where it would point to the middle of the grid.
    """

    height: float
    standoff: float
    side: float
    tilt: float
    plate: float | None
    folder: ArmFolder | None = None
    left: float = 0.0

    @property
    def out(self) -> float:
        """m, from the last joint to the plate."""
        return float(np.linalg.norm(self.arm().packed.plate)) if self.plate is None else self.plate

    def arm(self) -> ServoArm:
        """The arm on this base."""
        yaw = np.radians(self.side)
        x = DEPTH - self.standoff * np.cos(yaw) - self.left * np.sin(yaw)
        y = self.left * np.cos(yaw) - self.standoff * np.sin(yaw)
        mount = Mount((float(x), float(y), self.height), float(yaw), float(np.radians(self.tilt)))
        return ServoArm(mount, self.plate, folder=self.folder or find_arm())


@dataclass(frozen=True)
class CellReach:
    """What a base can do at one cell.

    Attributes:
        cell: its name.
        lacking: why it is not reached, in a few words; '' where it is, inside limits, clear of everything, and agile.
        miss: m, what is left of position and normal; of an arm of fewer than six joints, of the position.
        turned: rad, of the plate's normal from the one that is wanted.
        joints: (J,) rad.
        margin: rad, smallest distance of waist, shoulder, elbow and wrist angle from a limit.
        gap: m, to floor, mount and arm itself.
        agility: smallest singular value of the plate's Jacobian.
        seconds: quickest reach from the ready posture.
    """

    cell: str
    lacking: str
    miss: float
    turned: float
    joints: Array
    margin: float
    gap: float
    agility: float
    seconds: float

    @property
    def reached(self) -> bool:
        """Nothing is lacking."""
        return not self.lacking


@dataclass(frozen=True)
class BaseReach:
    """What a base can do: its ready posture (J,), rad, and each cell."""

    base: Base
    ready: Array
    cells: tuple[CellReach, ...]

    @property
    def reached(self) -> int:
        """Number of cells."""
        return sum(cell.reached for cell in self.cells)

    @property
    def slowest(self) -> float:
        """s, to the cell that takes longest of those that are reached; of none, of all."""
        return max(cell.seconds for cell in self.cells if cell.reached or not self.reached)

    @property
    def margin(self) -> float:
        """rad, at the cell with the least."""
        return min(cell.margin for cell in self.cells)

    @property
    def rank(self) -> tuple[int, float]:
        """Larger is better: more cells, then the quicker slowest reach, a degree of margin being worth 2 ms."""
        return self.reached, 0.002 * min(float(np.degrees(self.margin)), 45.0) - self.slowest


def facing(degrees: float = 0.0) -> Array:
    """Normal (3,) of a plate that meets the person's palm, turned ``degrees`` further to the left."""
    angle = FACING + np.radians(degrees)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def cell_point(cell: str) -> Array:
    """Where the palms meet at a cell, (3,) m."""
    row, column = divmod(CELLS.index(cell), 3)
    return np.array([DEPTH, GRID_Y[column], GRID_Z[row]])


def ready_point() -> Array:
    """Where the plate waits, (3,) m: behind the middle of the grid."""
    return np.array([DEPTH, 0.0, GRID_Z[1] - DOWN]) - BACK * facing()


def reach_of(base: Base, settings: ReachabilitySettings = REACHABILITY) -> BaseReach:
    """Solves for postures of the ready plate and of every cell, and takes those that are quickest from each other."""
    arm, normal = base.arm(), facing()
    ready = postures(arm, ready_point(), normal, settings)
    at_cells = [postures(arm, cell_point(cell), normal, settings) for cell in CELLS]
    reaches = (from_ready(base, arm, start, at_cells, settings) for start, _ in ready[:6])
    return max(reaches, key=lambda reach: reach.rank)


def postures(
    arm: ServoArm, point: Array, normal: Array, settings: ReachabilitySettings = REACHABILITY
) -> list[tuple[Array, float]]:
    """Different postures (J,) that put the plate there, with what they miss by; at least the one that is nearest."""
    draws = np.random.default_rng(0).uniform(0.7 * arm.packed.low, 0.7 * arm.packed.high, (settings.starts, arm.joints))
    if idle(arm):
        draws[:, -1] = 0.0  # turns the plate in itself, which changes nothing
    found: list[tuple[Array, float]] = []
    for start in draws:
        joints, miss = solve(arm, point, normal, start, 60)
        if not found or miss > settings.near:
            if not found or miss < found[0][1]:
                found[:1] = [(joints, miss)]
            continue
        if found[0][1] > settings.near:
            found = []
        if all(np.abs(joints - other).max() > 0.1 for other, _ in found):
            found.append((joints, miss))
    return found


def idle(arm: ServoArm) -> bool:
    """Whether the last joint turns the plate in itself alone, which changes nothing."""
    return bool(abs(arm.packed.axes[-1] @ arm.packed.normal) > 1.0 - 1e-6)


def smallest_margin(arm: ServoArm, joints: Array) -> float:
    """rad, to the nearest stop, of the base's joint and of all that cannot go round."""
    near = arm.packed.high - arm.packed.low < 2.0 * np.pi - 1e-6
    near[0] = True
    return float(arm.margins(joints)[near].min())


def as_mounted(folder: ArmFolder) -> BaseReach:
    """What an arm reaches where its folder puts it."""
    x, y, height = folder.mount.position
    yaw, away = folder.mount.yaw, np.array([DEPTH - x, -y])
    along = np.array([np.cos(yaw), np.sin(yaw)])
    left = float(-along[0] * away[1] + along[1] * away[0])
    tilt = float(np.degrees(folder.mount.tilt))
    base = Base(height, float(along @ away), float(np.degrees(yaw)), tilt, None, folder, left)
    arm = base.arm()
    at_cells = [postures(arm, cell_point(cell), facing()) for cell in CELLS]
    return from_ready(base, arm, np.array(folder.ready), at_cells)


def from_ready(
    base: Base,
    arm: ServoArm,
    ready: Array,
    at_cells: list[list[tuple[Array, float]]],
    settings: ReachabilitySettings = REACHABILITY,
) -> BaseReach:
    """The base with that ready posture (J,), and of each cell's postures the one that is quickest from it."""
    rated = [
        [_rated(arm, cell, *it, ready, settings) for it in found] for cell, found in zip(CELLS, at_cells, strict=True)
    ]
    return BaseReach(base, ready, tuple(max(cells, key=lambda it: (it.reached, -it.seconds)) for cells in rated))


def _rated(arm: ServoArm, cell: str, joints: Array, miss: float, ready: Array, s: ReachabilitySettings) -> CellReach:
    plate = arm.plate_at(joints)
    values = np.linalg.svd(np.vstack([plate.jacobian, 0.2 * plate.normal_jacobian]), compute_uv=False)
    margin, gap = smallest_margin(arm, joints), arm.clearance(joints)
    turned = float(np.arccos(np.clip(plate.normal @ facing(), -1.0, 1.0)))
    if arm.joints < SIX:  # the normal is met as far as it can be
        miss = float(np.linalg.norm(plate.position - cell_point(cell)))
        values = np.linalg.svd(plate.jacobian, compute_uv=False)
        agility, near, least, clear = float(values[-1]), s.near_fewer, s.margin_fewer, s.gap_fewer
    else:
        agility, near, least, clear = float(values[4]), s.near, s.margin, s.gap
    lacking = ""
    if miss >= near:
        lacking = f"{100.0 * miss:.0f} cm short" if miss > 0.01 else f"{1e3 * miss:.0f} mm short"
    elif arm.joints < SIX and turned >= s.turned_fewer:
        lacking = f"turned away by {np.degrees(turned):.0f}°"
    elif margin <= least:
        lacking = f"a joint {np.degrees(margin):.0f}° from its limit"
    elif gap <= clear:
        lacking = f"{100.0 * gap:.0f} cm from touching something"
    elif agility <= s.agile:
        lacking = "the arm is nearly straight"
    seconds = float(dynamics.quickest(arm.packed, ready, joints))
    return CellReach(cell, lacking, miss, turned, joints, margin, gap, agility, seconds)


def better_ready(reach: BaseReach, settings: ReachabilitySettings = REACHABILITY) -> BaseReach:
    """The same base with a ready posture from which its slowest cell is reached sooner (Nelder–Mead over the joints).

    The plate stays behind the plane of contact, about where it was, and faces about the person.
    """
    arm, normal, middle = reach.base.arm(), facing(), ready_point()
    at_cells = [postures(arm, cell_point(cell), normal, settings) for cell in CELLS]
    good = [
        [joints for joints, miss in found if _rated(arm, cell, joints, miss, reach.ready, settings).reached]
        for cell, found in zip(CELLS, at_cells, strict=True)
    ]

    def cost(five: Array) -> float:
        ready = np.append(five, 0.0)
        times = [min((dynamics.quickest(arm.packed, ready, it) for it in found), default=2.0) for found in good]
        plate = arm.plate_at(ready)
        behind = float((plate.position - middle) @ normal)
        aside = float(np.linalg.norm(plate.position - middle))
        turned = float(np.arccos(np.clip(plate.normal @ normal, -1.0, 1.0)))
        out = max(0.0, behind - 0.02) + max(0.0, aside - 0.12) + max(0.0, turned - settings.aside)
        out += max(0.0, float(settings.margin - smallest_margin(arm, ready)))
        return max(times) + 0.3 * float(np.mean(times)) + 20.0 * out

    found = minimize(cost, reach.ready[:5], method="Nelder-Mead", options={"maxfev": settings.rounds, "xatol": 1e-3})
    return from_ready(reach.base, arm, np.append(found.x, 0.0), at_cells, settings)


def bases(settings: ReachabilitySettings = REACHABILITY) -> list[Base]:
    """Every base of the search."""
    s = settings
    return [Base(*values) for values in itertools.product(s.heights, s.standoffs, s.sides, s.tilts, s.plates)]


def search(
    chosen: Sequence[Base],
    advance: Callable[[], None] = lambda: None,
    settings: ReachabilitySettings = REACHABILITY,
) -> list[BaseReach]:
    """Every base's reach, the best first; the best few with a better ready posture than the first that was found."""
    found = []
    for base in chosen:
        found.append(reach_of(base, settings))
        advance()
    found.sort(key=lambda reach: reach.rank, reverse=True)
    best = found[: settings.finalists]
    found[: settings.finalists] = [better_ready(reach, settings) for reach in best]
    return sorted(found, key=lambda reach: reach.rank, reverse=True)


CHOSEN = Base(1.28, 0.57, 8.0, 15.0, 0.18)
"""The base that the arm stands on (:data:`highfive.hil.arm_model.servo_arm.DEFAULT_MOUNT`)."""


@dataclass(frozen=True)
class Tried:
    """What the retargeting makes of a base: m, miss of the plate ``notice`` s after it first knew of a still hand."""

    notice: float
    median: float
    largest: float


def tried(reach: BaseReach, notice: float = 0.45) -> Tried:
    """High fives at two places about each cell that is reached, the hand held still, known of ``notice`` s before."""
    rng, settings = np.random.default_rng(0), RetargetSettings(lag=0.0, press=0.0)
    retarget = Retarget(reach.base.arm(), reach.ready, settings)
    misses = []
    able = [cell.cell for cell in reach.cells if cell.reached] or CELLS
    for cell in (cell for cell in able for _ in range(2)):
        point, normal = cell_point(cell) + rng.normal(0.0, 0.025, 3), facing(float(rng.normal(0.0, 4.0)))
        hand, state = PalmPose(point, -normal, UP, np.zeros(3)), retarget.start()
        for tick in range(round(notice / settings.tick)):
            left = notice - tick * settings.tick
            ours = PalmPose(point - 0.5 * left * normal, normal, UP, 0.5 * normal)
            contact = ExpectedContact(point, 1e-6 * np.eye(3), normal, left)
            state, _ = retarget.step(state, PalmGoal(ours, hand, None, contact))
        misses.append(float(np.linalg.norm(retarget.arm.plate_at(state.joints).position - point)))
    return Tried(notice, float(np.median(misses)), max(misses))
