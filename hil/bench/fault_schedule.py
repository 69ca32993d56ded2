"""What goes wrong in a session of one high five with the emulated rig, and when: drawn from a seed. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.hil.drivers.emulator.bus_faults import BusFault, parse_fault

SERVOS = tuple(range(1, 9))

SWITCHING_ON, FOLLOWING, RETURNING = "switching on", "following", "returning"

PHASES = {SWITCHING_ON: 2.1, FOLLOWING: 2.4, RETURNING: 1.5}
"""Parts of a session, and how long each takes where nothing goes wrong, s: the source is opened, servos are looked at,
checked and switched on; the arm follows; it goes back to where it rests, what it did is recorded, it is let go of."""

_PHASE_SHARES = (0.2, 0.6, 0.2)

MOCAP = ("stall", "burst", "occlusion", "swap", "ghost", "clock jump", "drop")
"""What happens to frames: none come; none come and then all at once; all markers hidden; two labels exchanged; a marker
elsewhere; the source's clock jumps; single frames are lost."""

STOPS, DEATHS = ("emergency stop", "Ctrl-C"), ("host killed", "driver killed", "machine killed")
STALLS = ("host stall", "driver stall", "machine stall")
"""What happens to the programs; a machine is host and driver, and its servos go on."""

FULL_DISK = "full disk"

BUS = ("dead", "late", "crc", "noise", "half", "overload", "hot", "brownout", "unplug", "slip")
"""Of :data:`highfive.hil.drivers.emulator.bus_faults.KINDS` those that happen to an arm in order."""

KINDS = (*BUS, *STOPS, *DEATHS, *STALLS, *MOCAP, FULL_DISK)

GROUPS = (STOPS, DEATHS, (*STALLS, "stall", "burst", "occlusion"), BUS, (*MOCAP, FULL_DISK), KINDS)
"""The first happening of a seed's schedule is of one of these, which take turns: each is met in any few schedules."""

MOST = 3
SHORTEST_S, LONGEST_S = 0.02, 5.0
"""What lasts takes so long, s, by the logarithm alike ..."""
ENDLESS_S, ENDLESS = 32.0, 0.04
"""... but a standstill of a program, that often, longer than every time-out of host and driver, s."""
MOST_LOOKS = 300
"""A kill or Ctrl-C comes this many looks at the clock after its time at most: in the midst of a cycle or a tick."""

_ENDS = {*STOPS, *DEATHS, FULL_DISK, "overload", "slip", "clock jump"}


@dataclass(frozen=True)
class Happening:
    """One thing that goes wrong.

    Attributes:
        kind: one of :data:`KINDS`.
        at_s: when, s from when its phase begins.
        lasts_s: how long; 0 for an instant, or for good.
        amount: ms of a late reply, share of damaged ones, V, °, m or s, bytes that a disk still takes, by kind.
        servo: whom it concerns; None for nobody, or for all.
        phase: one of :data:`PHASES`; what happens in one that never begins does not happen.
        looks: of who is killed or interrupted at the clock, from then until it comes; 0: where it waits.
    """

    kind: str
    at_s: float
    lasts_s: float = 0.0
    amount: float = 0.0
    servo: int | None = None
    phase: str = FOLLOWING
    looks: int = 0

    def __str__(self) -> str:
        """In words."""
        who = "" if self.servo is None else f" {self.servo}"
        size = f" {self.amount:.3g}" if self.amount else ""
        lasts = f" for {1e3 * self.lasts_s:.0f} ms" if self.lasts_s else ""
        looks = f" and {self.looks} looks" if self.looks else ""
        return f"{self.kind}{who}{size} at {self.at_s:.3f} s{looks} of {self.phase}{lasts}"

    def bus_fault(self) -> BusFault:
        """The same for the bus."""
        who = "" if self.servo is None else f"={self.servo}"
        size = f":{self.amount:.4f}" if self.amount else ""
        end = f"-{self.at_s + self.lasts_s:.6f}" if self.lasts_s else ""
        return parse_fault(f"{self.kind}{who}{size}@{self.at_s:.6f}{end}")


@dataclass(frozen=True)
class FaultSchedule:
    """One to :data:`MOST` things that go wrong in one high five.

    Attributes:
        seed: of all that is left to chance.
        trial: number of the high five.
        happenings: in the order of their times.
    """

    seed: int
    trial: int
    happenings: tuple[Happening, ...]

    def __str__(self) -> str:
        """In words."""
        return f"seed {self.seed}, high five {self.trial}: {'; '.join(map(str, self.happenings))}"

    def of(self, *kinds: str) -> list[Happening]:
        """Those of some kinds."""
        return [it for it in self.happenings if it.kind in kinds]


def drawn(seed: int, trials: int) -> FaultSchedule:
    """The schedule of a seed, for one of ``trials`` high fives."""
    rng = np.random.default_rng(seed)
    first = str(rng.choice(GROUPS[seed % len(GROUPS)]))
    others = rng.choice([kind for kind in KINDS if kind != first], int(rng.integers(MOST)), replace=False)
    found = [_happening(kind, rng) for kind in (first, *map(str, others))]
    order = list(PHASES)
    found.sort(key=lambda it: (order.index(it.phase), it.at_s))
    return FaultSchedule(seed, int(rng.integers(trials)), tuple(found))


def _happening(kind: str, rng: np.random.Generator) -> Happening:
    phase = str(rng.choice(list(PHASES), p=_PHASE_SHARES))
    at = float(rng.uniform(0.0, PHASES[phase]))
    lasts = 0.0 if kind in _ENDS else _log_uniform(rng, SHORTEST_S, LONGEST_S)
    if kind in STALLS and rng.random() < ENDLESS:
        lasts = ENDLESS_S
    servo = int(rng.choice(SERVOS)) if kind in {"dead", "overload", "hot", "slip"} or rng.random() < 0.5 else None
    amount = {
        "late": lambda: float(rng.uniform(1.0, 60.0)),
        "crc": rng.random, "noise": rng.random, "half": rng.random,
        "hot": lambda: float(rng.uniform(60.0, 90.0)),
        "brownout": lambda: float(rng.uniform(4.0, 11.0)),
        "slip": lambda: float(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 8.0)),
        "ghost": lambda: float(rng.uniform(0.05, 1.0)),
        "clock jump": lambda: float(rng.choice([-1.0, 1.0]) * _log_uniform(rng, 0.01, 100.0)),
        "drop": lambda: float(rng.uniform(0.1, 0.9)),
        FULL_DISK: lambda: _log_uniform(rng, 100.0, 300_000.0),
    }.get(kind, lambda: 0.0)()  # fmt: skip
    looks = int(_log_uniform(rng, 1.0, MOST_LOOKS + 1.0)) if kind in (*DEATHS, "Ctrl-C") and rng.random() < 0.7 else 0
    named = kind in BUS and kind not in {"unplug"}
    return Happening(kind, at, lasts, float(amount), servo if named else None, phase, looks)


def _log_uniform(rng: np.random.Generator, least: float, most: float) -> float:
    return float(np.exp(rng.uniform(np.log(least), np.log(most))))
