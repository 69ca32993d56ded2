"""Files of other programs, written by the formats' descriptions: what the parsers have to read."""

from collections.abc import Sequence

import numpy as np


def trc(names: Sequence[str], points: np.ndarray, rate: float, unit: str = "mm") -> str:
    """Points (T, M, 3) in their unit, NaN where missing."""
    count, markers = points.shape[:2]
    lines = ["PathFileType\t4\t(X/Y/Z)\ttrial.trc"]
    lines.append("DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames")
    lines.append(f"{rate:.2f}\t{rate:.2f}\t{count}\t{markers}\t{unit}\t{rate:.2f}\t1\t{count}")
    lines.append("Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t")
    lines.append("\t\t" + "\t".join(f"X{m}\tY{m}\tZ{m}" for m in range(1, markers + 1)))
    lines.append("")
    for t, row in enumerate(points.reshape(count, -1)):
        cells = ["" if np.isnan(value) else f"{value:.6f}" for value in row]
        lines.append("\t".join([str(t + 1), f"{t / rate:.6f}", *cells]))
    return "\n".join(lines) + "\n"


def table(names: Sequence[str], points: np.ndarray, rate: float, separator: str = ",", comma: str = ".") -> str:
    """The same as a wide table; ``comma`` stands before decimals."""
    lines = [separator.join(["time", *(f"{name}_{axis}" for name in names for axis in "xyz")])]
    for t, row in enumerate(points.reshape(len(points), -1)):
        cells = [f"{t / rate:.6f}", *("" if np.isnan(value) else f"{value:.6f}" for value in row)]
        lines.append(separator.join(cell.replace(".", comma) for cell in cells))
    return "\n".join(lines) + "\n"


def y_up(points: np.ndarray) -> np.ndarray:
    """From z up, as here, to y up, as there: z goes to y, y to −z."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)
