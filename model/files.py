"""Files that are written beside and renamed: whoever looks, and whatever happens, finds the old one or the new one."""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from stat import S_ISDIR, S_ISREG

from highfive.model.errors import HighFiveError

DEFAULT_MODEL = Path(__file__).with_name("default.safetensors")
"""The model that ships with the project, trained on simulated pairs (``make model``)."""

UNFINISHED = ".highfive-"
"""What the names of files begin with that are still being written, and of what a killed command left."""


def check_size(path: Path, most_bytes: int) -> None:
    """Sees to it that a file ends, and fits into the memory that its reader was made for.

    Raises:
        HighFiveError: it is none (a folder, a pipe, a device, of which reading may never end), or is larger.
        OSError: it is not there, or nobody may look at it.
    """
    status = path.stat()
    if not S_ISREG(status.st_mode):
        raise HighFiveError(f"{path} is {'a folder' if S_ISDIR(status.st_mode) else 'no file'}; give a file")
    if status.st_size > most_bytes:
        raise HighFiveError(f"{path} has {status.st_size} bytes, more than the limit of {most_bytes}")


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """The content of a file that ends, and is no larger than its reader was made for.

    Raises:
        HighFiveError, OSError: as :func:`check_size`.
    """
    check_size(path, most_bytes)
    return path.read_bytes()


def read_bounded_text(path: Path, most_bytes: int) -> str:
    """As :func:`read_bounded`, of a text in UTF-8; each end of a line is a line feed.

    Raises:
        HighFiveError, OSError: as there.
        UnicodeDecodeError: it is no such text.
    """
    check_size(path, most_bytes)
    return path.read_text(encoding="utf-8")


def unfinished(path: Path) -> Path:
    """A name beside ``path`` that nobody else uses, with the same ending."""
    return path.with_name(f"{UNFINISHED}{secrets.token_hex(4)}-{path.name}")


def leftovers(path: Path) -> list[Path]:
    """What has an :func:`unfinished` name of ``path``, sorted: what killed commands left, and what is being written."""
    name = re.compile(rf"{re.escape(UNFINISHED)}[0-9a-f]{{8}}-{re.escape(path.name)}")
    return sorted(found for found in path.parent.iterdir() if name.fullmatch(found.name))


@contextmanager
def written_whole(path: Path, *, replace: bool = True) -> Generator[Path]:
    """Gives a new, empty file beside ``path`` to write to, which gets its name in the end; after a failure it is gone.

    Args:
        path: in a folder that is there.
        replace: whether a file that has that name may be replaced.

    Raises:
        FileExistsError: there is such a file, and it may not be replaced.
        OSError: the file cannot be made, or its content is not safe on the disk.
    """
    partial = unfinished(path)
    os.close(os.open(partial, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    try:
        yield partial
        with partial.open("rb") as file:
            os.fsync(file.fileno())
        if replace:
            os.replace(partial, path)
        else:
            _take_free_name(partial, path)
    finally:
        with suppress(OSError):  # what kept it from being written may keep it from being removed
            partial.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes, *, replace: bool = True) -> None:
    """Writes a file in one piece; see :func:`written_whole`."""
    with written_whole(path, replace=replace) as partial:
        partial.write_bytes(content)


def _take_free_name(partial: Path, path: Path) -> None:
    """Gives a file its name unless that is taken, in one step where the file system can."""
    try:
        os.link(partial, path)
    except FileExistsError:
        raise
    except OSError:  # no second names on this file system
        if os.path.lexists(path):
            raise FileExistsError(17, "File exists", str(path)) from None
        os.replace(partial, path)
