"""The same motion in a BVH file as another program would have written it; and one without some of its joints.

Knows the format alone, through ``bvh_by_the_format``.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from bvh_by_the_format import Bvh, Node
from scipy.spatial.transform import Rotation

Columns = dict[str, np.ndarray]


def rewritten(bvh: Bvh, rng: np.random.Generator, scale: float = 1.0, late: bool = False, up: str = "y") -> Bvh:
    """Joints with one parent in another order, each with another order of its rotations, in another unit.

    ``late`` has positions behind rotations; ``up`` is the vertical, y as it was, or z.
    """
    columns = _by_node(bvh)
    quarter = Rotation.from_euler("x", 90.0, degrees=True)  # y to z, z to -y

    def turned(node: Node, root: bool) -> Node:
        own = columns[id(node)]
        turns = [channel for channel in node.channels if channel.endswith("rotation")]
        places = [channel for channel in node.channels if channel.endswith("position")]
        matrix = Rotation.identity(len(bvh.rows))
        for channel in turns:
            matrix = matrix * Rotation.from_euler(channel[0].lower(), own[channel][:, None], degrees=True)
        point = scale * np.stack([own[f"{axis}position"] for axis in "XYZ"], axis=-1) if places else None
        if root and up == "z":
            matrix, point = quarter * matrix, None if point is None else quarter.apply(point)
        new = Node(node.name, scale * node.offset)
        made: Columns = {} if point is None else {f"{axis}position": point[:, "XYZ".index(axis)] for axis in "XYZ"}
        order = "".join(rng.permutation(list("XYZ")))
        if turns:
            angles = matrix.as_euler(order, degrees=True)
            made |= {f"{axis}rotation": angles[:, i] for i, axis in enumerate(order)}
        names = [f"{axis}rotation" for axis in order] if turns else []
        moves = list(rng.permutation(places)) if late else places
        new.channels = [*names, *moves] if late else [*moves, *names]
        values[id(new)] = made
        new.children = [turned(node.children[i], False) for i in rng.permutation(len(node.children))]
        return new

    values: dict[int, Columns] = {}
    roots = [turned(root, True) for root in bvh.roots]
    return replace(bvh, roots=roots, rows=_rows(roots, values, len(bvh.rows)))


def without(bvh: Bvh, name: str) -> Bvh:
    """Ends where that joint was."""
    columns = _by_node(bvh)
    values: dict[int, Columns] = {}

    def kept(node: Node, parent: str) -> Node:
        if node.name == name:
            return Node(f"{parent}_end", node.offset)
        new = Node(node.name, node.offset, node.channels, [kept(child, node.name) for child in node.children])
        values[id(new)] = columns[id(node)]
        return new

    roots = [kept(root, "") for root in bvh.roots]
    return replace(bvh, roots=roots, rows=_rows(roots, values, len(bvh.rows)))


def text_of(bvh: Bvh) -> str:
    """The file."""
    lines = ["HIERARCHY"]

    def put(node: Node, kind: str, depth: int) -> None:
        inner = "\t" * (depth + 1)
        title = f"{kind} {node.name}" if node.channels else "End Site"
        lines.extend(["\t" * depth + title, "\t" * depth + "{"])
        lines.append(inner + "OFFSET " + " ".join(f"{x:.9g}" for x in node.offset))
        if node.channels:
            lines.append(f"{inner}CHANNELS {len(node.channels)} {' '.join(node.channels)}")
        for child in node.children:
            put(child, "JOINT", depth + 1)
        lines.append("\t" * depth + "}")

    for root in bvh.roots:
        put(root, "ROOT", 0)
    lines += ["MOTION", f"Frames: {len(bvh.rows)}", f"Frame Time: {bvh.frame_time:.7f}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in bvh.rows]
    return "\n".join(lines) + "\n"


def names_of(bvh: Bvh) -> list[str]:
    """Joints and end sites, in the file's order."""
    return [node.name for node in _walk(bvh.roots)]


def _walk(roots: list[Node]) -> Iterator[Node]:
    for node in roots:
        yield node
        yield from _walk(node.children)


def _by_node(bvh: Bvh) -> dict[int, Columns]:
    found, column = dict[int, Columns](), 0
    for node in _walk(bvh.roots):
        found[id(node)] = {channel: bvh.rows[:, column + i] for i, channel in enumerate(node.channels)}
        column += len(node.channels)
    return found


def _rows(roots: list[Node], values: dict[int, Columns], frames: int) -> np.ndarray:
    whole = [values[id(node)][channel] for node in _walk(roots) for channel in node.channels]
    return np.stack(whole, axis=-1) if whole else np.zeros((frames, 0))
