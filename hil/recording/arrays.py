"""Messages of a recording as arrays, and as a table where pandas is installed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from highfive.model.errors import HighFiveError

if TYPE_CHECKING:
    from pandas import DataFrame  # pyright: ignore[reportMissingImports]


_DEEPEST = 8
"""Objects within each other that are laid flat; ours have two."""
_MOST_BYTES = 1 << 30
"""Of an array: all rows are as long as the longest."""


def message_arrays(times_ns: Sequence[int], messages: Sequence[Mapping[str, Any]]) -> dict[str, NDArray[Any]]:
    """One array per field, (T,) or (T, …), of T messages; ``time`` (T,) is in s.

    A field within a field is named with a dot (``palm.position``). A number that a message lacks is NaN; a text that it
    lacks is ''. What differs in shape from message to message is an array of objects.
    """
    flat = [_flat(message) for message in messages]
    names = dict.fromkeys(name for row in flat for name in row)
    columns = {name: _stacked([row.get(name) for row in flat]) for name in names}
    return {"time": 1e-9 * np.asarray(times_ns, dtype=float), **columns}


def message_table(arrays: Mapping[str, NDArray[Any]]) -> DataFrame:
    """Arrays as a pandas table, a row a message; what has several numbers gets a column each (``root.0``).

    Raises:
        HighFiveError: pandas is not installed.
    """
    try:
        import pandas  # noqa: PLC0415  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise HighFiveError("a table needs pandas, which is not installed; pip install pandas") from None
    columns: dict[str, NDArray[Any]] = {}
    for name, values in arrays.items():
        if values.ndim == 1:
            columns[name] = values
        else:
            wide = values.reshape(len(values), -1)
            columns |= {f"{name}.{number}": wide[:, number] for number in range(wide.shape[1])}
    return pandas.DataFrame(columns)


def _flat(message: Mapping[str, Any], prefix: str = "", depth: int = 0) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in message.items():
        if isinstance(value, Mapping) and depth < _DEEPEST:
            found |= _flat(value, f"{prefix}{name}.", depth + 1)
        else:
            found[prefix + name] = value
    return found


def _stacked(values: Sequence[Any]) -> NDArray[Any]:
    present = [value for value in values if value is not None]
    if present and all(isinstance(value, str) for value in present):
        fits = 4 * max(map(len, present)) * len(values) <= _MOST_BYTES
        return np.array([value or "" for value in values], dtype=np.str_ if fits else object)
    for kind in (bool, int):
        if len(present) == len(values) and all(type(value) is kind for value in values):
            return np.array(values)
    try:
        shape = np.shape(np.array(present[0], dtype=float)) if present else ()
        if 8 * prod(shape) * len(values) > _MOST_BYTES:
            raise ValueError("one is so long that an array of all would not fit")
        missing = np.full(shape, np.nan)
        return np.array([missing if value is None else np.array(value, dtype=float) for value in values])
    except (TypeError, ValueError, OverflowError):  # texts in a list, lists of different lengths, or huge numbers
        objects = np.empty(len(values), dtype=object)
        objects[:] = list(values)
        return objects
