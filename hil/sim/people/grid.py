"""The imaginary grid of places at which palms meet."""

from __future__ import annotations

GRID_Y = (-0.25, 0.0, 0.25)
GRID_Z = (1.2, 1.4, 1.6)
CELLS = tuple(f"{row}{column}" for row in "ABC" for column in "123")
"""Cells of the imaginary grid: rows A to C from low to high, columns 1 to 3 from the avatar's right to its left."""
