"""Archives of arrays (.npz): what they hold is looked at before it is unpacked."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from highfive.model.errors import HighFiveError
from highfive.model.files import check_size

MOST_BYTES = 2 << 30
"""Of the file, and of all that is in it."""
_PACKED, _ALWAYS = 50, 64 << 20
"""What is packed unpacks to so many times its bytes, or to so many: a megabyte of zeros can be a gigabyte."""
MOST_ARRAYS = 1000


def read_npz(path: Path) -> dict[str, NDArray[Any]] | None:
    """The arrays of an archive by name; None where it holds no arrays with names.

    Raises:
        HighFiveError: it is no file, is damaged, is larger than :data:`MOST_BYTES`, unpacks to more, or holds objects.
        OSError: it is not there, or cannot be read.
    """
    check_size(path, MOST_BYTES)
    try:
        if zipfile.is_zipfile(path):
            _check_members(path)
        with path.open("rb") as file:  # left to NumPy, a damaged one stays open
            stored = np.load(file, allow_pickle=False)
            if not isinstance(stored, np.lib.npyio.NpzFile):
                return None
            return {name: np.asarray(cast(Any, stored[name])) for name in stored.files}
    except (OSError, HighFiveError):
        raise
    except Exception:  # zipfile, zlib, lzma, numpy and the parser of a header each have their own
        raise HighFiveError(f"{path} is no archive of arrays (.npz), or it is cut short or damaged") from None


def _check_members(path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
    size = sum(member.file_size for member in members)  # more than it says is not unpacked
    most = min(MOST_BYTES, _ALWAYS + _PACKED * path.stat().st_size)
    if size > most or len(members) > MOST_ARRAYS:
        raise HighFiveError(
            f"{path} unpacks to {len(members)} arrays of {size} bytes; at most {MOST_ARRAYS} and {most} are read"
        )
