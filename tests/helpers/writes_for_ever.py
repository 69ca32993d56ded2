"""Writes a file again and again until somebody kills it; a process that starts with this imports next to nothing."""

from pathlib import Path

from highfive.model.files import write_whole


def write_for_ever(path: Path) -> None:
    """400 kB of one byte, then of the next."""
    for number in range(1_000_000):
        write_whole(path, bytes([number % 256]) * 400_000)
