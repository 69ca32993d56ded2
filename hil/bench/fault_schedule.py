"""What goes wrong in a high five with the emulated rig, and when: drawn from a seed. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from highfive.hil.drivers.emulator.bus_faults import BusFault, parse_fault

SERVOS = tuple(range(1, 9))

MOCAP = ("stall", "burst", "occlusion", "swap", "ghost", "clock jump", "drop")
"""What happens to frames: none come; none come and then all at once; all markers hidden; two labels exchanged; a marker
elsewhere; the source's clock jumps; single frames are lost."""

HOST = ("host stall", "driver stall", "machine stall", "host killed", "driver killed", "emergency stop", "Ctrl-C")
"""What happens to the programs; a machine that stalls is host and driver, and its servos go on."""

FULL_DISK = "full disk"

BUS = ("dead", "late", "crc", "noise", "half", "overload", "hot", "brownout", "unplug", "slip")
"""Of :data:`highfive.hil.drivers.emulator.bus_faults.KINDS` those that happen to an arm in order."""

KINDS = (*BUS, *HOST, *MOCAP, FULL_DISK)

LONGEST_S, MOST = 0.6, 3
_ENDS = {"host killed", "driver killed", "emergency stop", "Ctrl-C", FULL_DISK, "overload", "slip", "clock jump"}


@dataclass(frozen=True)
class Happening:
    """One thing that goes wrong.

    Attributes:
        kind: one of :data:`KINDS`.
        at_s: when, s from when the arm begins to follow.
        lasts_s: how long; 0 for an instant, or for good.
        amount: ms of a late reply, share of damaged ones, V, °, m or s, by kind.
        servo: whom it concerns; None for nobody, or for all.
    """

    kind: str
    at_s: float
    lasts_s: float = 0.0
    amount: float = 0.0
    servo: int | None = None

    def __str__(self) -> str:
        """In words."""
        who = "" if self.servo is None else f" {self.servo}"
        size = f" {self.amount:.3g}" if self.amount else ""
        lasts = f" for {1e3 * self.lasts_s:.0f} ms" if self.lasts_s else ""
        return f"{self.kind}{who}{size} at {self.at_s:.3f} s{lasts}"

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


def drawn(seed: int, trials: int, lasts_s: float) -> FaultSchedule:
    """The schedule of a seed, for one of ``trials`` high fives that take so long, s."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, MOST + 1))
    kinds = rng.choice(len(KINDS), count, replace=False)
    found = sorted((_happening(KINDS[kind], lasts_s, rng) for kind in kinds), key=lambda it: it.at_s)
    return FaultSchedule(seed, int(rng.integers(trials)), tuple(found))


def _happening(kind: str, within_s: float, rng: np.random.Generator) -> Happening:
    at = float(rng.uniform(0.0, within_s))
    lasts = 0.0 if kind in _ENDS else float(np.exp(rng.uniform(np.log(1e-3), np.log(LONGEST_S))))
    servo = int(rng.choice(SERVOS)) if kind in {"dead", "overload", "hot", "slip"} or rng.random() < 0.5 else None
    amount = {
        "late": lambda: float(rng.uniform(1.0, 60.0)),
        "crc": rng.random, "noise": rng.random, "half": rng.random,
        "hot": lambda: float(rng.uniform(60.0, 90.0)),
        "brownout": lambda: float(rng.uniform(4.0, 11.0)),
        "slip": lambda: float(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 8.0)),
        "swap": lambda: 0.0,
        "ghost": lambda: float(rng.uniform(0.05, 1.0)),
        "clock jump": lambda: float(rng.choice([-1.0, 1.0]) * np.exp(rng.uniform(np.log(0.01), np.log(100.0)))),
        "drop": lambda: float(rng.uniform(0.1, 0.9)),
    }.get(kind, lambda: 0.0)()  # fmt: skip
    named = kind in BUS and kind not in {"unplug"}
    return Happening(kind, at, lasts, float(amount), servo if named else None)
