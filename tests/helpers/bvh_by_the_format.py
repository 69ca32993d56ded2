"""BVH read by the format's description alone, with matrices: the oracle of what writes and of what reads it.

A joint's place is its parent's, and its OFFSET, or the position channels where it has them, in the parent's axes; its
rotations follow each other in the order of its channels. Meredith & Maddock 2001, §4.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass
class Node:
    name: str
    offset: np.ndarray = field(default_factory=lambda: np.zeros(3))
    channels: list[str] = field(default_factory=list)
    children: list["Node"] = field(default_factory=list)


@dataclass
class Bvh:
    roots: list[Node]
    frame_time: float
    rows: np.ndarray

    def places(self) -> dict[str, np.ndarray]:
        """Name -> (T, 3); an end site is called after its parent, with ``_end``."""
        found: dict[str, np.ndarray] = {}
        column = 0

        def walk(node: Node, place: np.ndarray, axes: np.ndarray) -> None:
            nonlocal column
            local = np.tile(node.offset, (len(self.rows), 1))
            turn = np.tile(np.eye(3), (len(self.rows), 1, 1))
            for channel in node.channels:
                values, axis = self.rows[:, column], channel[0].lower()
                column += 1
                if channel.endswith("position"):
                    local[:, "xyz".index(axis)] = values
                else:
                    turn = turn @ Rotation.from_euler(axis, values[:, None], degrees=True).as_matrix()
            here = place + np.einsum("tij,tj->ti", axes, local)
            found[node.name] = here
            for child in node.children:
                walk(child, here, axes @ turn)

        for root in self.roots:
            walk(root, np.zeros((len(self.rows), 3)), np.tile(np.eye(3), (len(self.rows), 1, 1)))
        assert column == self.rows.shape[1], "more values a frame than channels"
        return found


def read_bvh(path: Path) -> Bvh:
    head, motion = path.read_text().split("MOTION")
    words = iter(head.split())
    assert next(words) == "HIERARCHY"
    roots = []
    for word in words:
        assert word == "ROOT"
        roots.append(_node(next(words), words))
    frames, frame_time, *rows = motion.strip().splitlines()
    values = np.array([[float(word) for word in row.split()] for row in rows])
    assert int(frames.removeprefix("Frames:")) == len(values)
    return Bvh(roots, float(frame_time.removeprefix("Frame Time:")), values)


def _node(name, words) -> Node:
    node = Node(name)
    assert next(words) == "{"
    while (word := next(words)) != "}":
        if word == "OFFSET":
            node.offset = np.array([float(next(words)) for _ in range(3)])
        elif word == "CHANNELS":
            node.channels = [next(words) for _ in range(int(next(words)))]
        elif word == "JOINT":
            node.children.append(_node(next(words), words))
        else:
            assert (word, next(words)) == ("End", "Site")
            node.children.append(_node(f"{name}_end", words))
    return node
