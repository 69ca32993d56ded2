"""What a reader is for the fuzzer: sound inputs, how they are damaged, and what reads them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from highfive.hil.bench.fuzz_mutations import damaged_bytes

Damage = Callable[[Random, bytes, Sequence[bytes]], bytes]
"""Makes a damaged input of a sound one; the other sound ones are there to be mixed in."""


@dataclass(frozen=True)
class Seed:
    """A sound input.

    Attributes:
        content: its bytes.
        read: what a command does with such an input: content and a folder of its own go in, whatever comes out.
        damage: how it is damaged.
        ends: it is a connection, whose end is an error of ours; else a sound one must be read without any.
    """

    content: bytes
    read: Callable[[bytes, Path], Any]
    damage: Damage = damaged_bytes
    ends: bool = False


def of_file(name: str, read: Callable[[Path], Any]) -> Callable[[bytes, Path], Any]:
    """Reads a file of that name with the content."""

    def written(content: bytes, folder: Path) -> Any:
        path = folder / name
        path.write_bytes(content)
        return read(path)

    return written


def drawn(seeds: Sequence[Seed], reader: str, seed: int, number: int) -> tuple[Seed, bytes]:
    """One input: of what it is made, and its bytes; the same each time. The first ones are the sound ones."""
    one = seeds[number % len(seeds)]
    if number < len(seeds):
        return one, one.content
    rng = Random(f"{seed} {reader} {number}")
    return one, one.damage(rng, one.content, [other.content for other in seeds])
