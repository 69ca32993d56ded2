"""Where results go, and the one rule for them: what is there already stays, unless ``--overwrite`` is said."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from itertools import count
from pathlib import Path

from highfive.model.errors import HighFiveError
from highfive.model.files import UNFINISHED, write_whole

try:
    import fcntl
except ImportError:  # no such locks on this system
    fcntl = None


def next_folder(kind: str, base: Path = Path("out")) -> Path:
    """The first of ``out/KIND-1``, ``out/KIND-2``, … that is not there yet."""
    return next(folder for number in count(1) if not (folder := base / f"{kind}-{number}").exists())


@contextmanager
def results_folder(
    folder: Path, overwrite: bool = False, resumed: Callable[[Path], bool] = lambda entry: False
) -> Iterator[bool]:
    """Keeps a folder for one command's results: it is made, can be written to, and nobody else's work is in it.

    Meanwhile no other command may write there. If the command leaves nothing in a folder that was made, it goes.

    Args:
        folder: where results are to go; need not be there.
        overwrite: let it hold something; of that the command replaces or removes files of the names that it can write,
            no others.
        resumed: whether what lies there is the command's own unfinished work, with which it goes on.

    Yields:
        whether nobody else can be writing there: some file systems have no locks.

    Raises:
        HighFiveError: the folder holds something, is another command's, is none, or cannot be written to.
    """
    if folder.exists() and not folder.is_dir():
        raise HighFiveError(f"cannot write to {folder}: it is no folder; --out takes the name of a folder")
    made = [place for place in (folder, *folder.parents) if not place.exists()]
    with ExitStack() as stack:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            stack.callback(_remove_empty, made)
            free = stack.enter_context(locked(folder))
            if free is False:
                raise HighFiveError(f"another command is writing to {folder}; give another --out")
            taken = any(not (entry.name.startswith(UNFINISHED) or resumed(entry)) for entry in folder.iterdir())
            if taken and not overwrite:
                raise HighFiveError(f"{folder} holds something already; give another --out, or --overwrite")
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise HighFiveError(f"cannot write to {folder}: {error.strerror}; give another --out") from None
        yield bool(free)


def check_file(path: Path, overwrite: bool, option: str = "--out") -> None:
    """Sees to it that a file can be written in the end, before anything is worked out for it; makes its folder.

    Raises:
        HighFiveError: the file is there and may not be replaced, is no file, or its folder cannot be written to.
    """
    if path.is_dir():
        raise HighFiveError(f"{path} is a folder; {option} takes the name of a file")
    if os.path.lexists(path) and not overwrite:
        raise HighFiveError(f"{path} is there already; give another {option}, or --overwrite")
    if path.exists() and not path.is_file():
        raise HighFiveError(f"{path} is no file; give another {option}")
    above = next(place for place in path.parents if place.exists())
    if not above.is_dir():
        raise HighFiveError(f"cannot write to {path}: {above} is a file and no folder; give another {option}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise HighFiveError(f"cannot write to {path.parent}: {error.strerror}; give another {option}") from None


def check_toml(path: Path, what: str, overwrite: bool, option: str = "--out") -> None:
    """As :func:`check_file`, of a TOML file that is ``what``.

    Raises:
        HighFiveError: as there, or its name is no TOML file's.
    """
    if path.suffix != ".toml":
        raise HighFiveError(f"{option} {path}: {what} is a TOML file; write it as {path.stem}.toml")
    check_file(path, overwrite, option)


@contextmanager
def locked(folder: Path) -> Iterator[bool | None]:
    """Whether the folder is this process's until this is left; None where there are no locks. The killed hold none."""
    if fcntl is None:
        yield None
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        free: bool | None = True
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            free = False
        except OSError:  # a file system without locks
            free = None
        yield free
    finally:
        os.close(descriptor)


def _remove_empty(folders: list[Path]) -> None:
    """Removes those of the folders, the deepest first, in which there is nothing."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()


def write_file(path: Path, content: bytes, *, replace: bool = True) -> None:
    """Writes a file in one piece: after a failure the old one, or none, is there.

    Raises:
        HighFiveError: it cannot be written, or there is such a file and it may not be replaced.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, content, replace=replace)
    except OSError as error:
        raise HighFiveError(
            f"cannot write {path}: {error.strerror or error}; choose another place or make room"
        ) from None
