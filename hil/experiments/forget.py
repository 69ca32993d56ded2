"""A participant is forgotten: her plan, rows and recordings are deleted, and it is said what remains."""

from __future__ import annotations

import json
import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from highfive.hil.experiments.study import PARTICIPANTS, PLAN, PROTOCOL, participant_folder, participants
from highfive.hil.runtime.folders import locked
from highfive.model.errors import HighFiveError
from highfive.model.files import read_bounded

BEYOND = "Not reached: exports and backups elsewhere, and the key that says who the code is; delete those yourself."

_LOOK = os.R_OK | os.X_OK
_MADE = ("dataset_description.json", "report.json")
"""What an export, and an analysis, have in their folder."""
_MOST_TEXT = 256 << 20
"""Bytes of the largest text in which the code is looked for: the largest table of motion."""
_MOST_SETTINGS = 4 << 20
_TEXTS = {".csv", ".html", ".json", ".jsonl", ".log", ".md", ".svg", ".toml", ".tsv", ".txt"}


@dataclass(frozen=True)
class Forgotten:
    """What was deleted, and where the code still stands.

    Attributes:
        participant: the code.
        deleted: files, below the study.
        shown_to: participants whose plans and recordings have her trials: she moves in them.
        mentioned: other files of the study in whose name or text the code is.
        beside: exports and results in the folder that the study is in, in whose files the code is, and copies of it.
        unread: files of all these that could not be looked into, or are too large.
    """

    participant: str
    deleted: tuple[str, ...]
    shown_to: tuple[str, ...]
    mentioned: tuple[str, ...]
    beside: tuple[str, ...]
    unread: tuple[str, ...]


def forget(study: Path, code: str) -> Forgotten:
    """Deletes all that a study has of a participant.

    Raises:
        HighFiveError: nothing is known of her, a run is going on, or something cannot be deleted.
    """
    folder = participant_folder(study, code)
    if not folder.is_dir() or folder.is_symlink():
        known = ", ".join(participants(study)) or "nobody"
        raise HighFiveError(f"{study} has no participant {code}; it has {known}")
    with locked(study) as free:
        if free is False:
            raise HighFiveError(f"a run is writing to {study}; forget {code} when it is over")
        deleted = sorted(path.relative_to(study).as_posix() for path in folder.rglob("*") if not path.is_dir())
        try:
            for path in sorted(folder.iterdir(), key=lambda path: path.name == PLAN):  # so that it can be done again
                shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
            folder.rmdir()
        except OSError as error:
            raise HighFiveError(
                f"cannot delete all of {folder}: {error.strerror or error} ({error.filename}); put that right, and "
                f"forget {code} again"
            ) from None
    mentions, unread = _mentions(study, code)
    others = {parts[1] for name in mentions if (parts := Path(name).parts)[0] == PARTICIPANTS and len(parts) > 2}
    beside, unread_beside = _beside(study, code)
    return Forgotten(
        code, tuple(deleted), tuple(sorted(others)),
        tuple(name for name in mentions if Path(name).parts[0] != PARTICIPANTS), tuple(beside),
        (*unread, *unread_beside),
    )  # fmt: skip


def _beside(study: Path, code: str) -> tuple[list[str], list[str]]:
    """Folders beside the study that one of our commands has written, copies of it among them, and in which the code
    stands, not the results of another study, of which that code is somebody else; and files that were not read."""
    whole = study.resolve()
    # What nobody may look into, this program's user has not written.
    there = [path for path in _entries(whole.parent) if path != whole and path.is_dir() and os.access(path, _LOOK)]
    made = [path for path in there if any((path / name).is_file() for name in _MADE) and not _of_another(path, study)]
    copies = {path.name for path in there if (path / PARTICIPANTS / code).is_dir() and _same_protocol(path, study)}
    found = {path.name: _mentions(path, code) for path in made}
    unread = [f"{name}/{file}" for name, (_, files) in sorted(found.items()) for file in files]
    return sorted(copies | {name for name, (mentions, _) in found.items() if mentions}), unread


def _entries(folder: Path) -> list[Path]:
    return list(folder.iterdir()) if os.access(folder, _LOOK) else []


def _of_another(results: Path, study: Path) -> bool:
    """Whether results say that they are of a study of another name."""
    try:
        source = json.loads(read_bounded(results / "report.json", _MOST_TEXT)).get("source")
    except (HighFiveError, OSError, ValueError, AttributeError, RecursionError):
        return False
    return isinstance(source, str) and Path(source).name != study.resolve().name


def _same_protocol(copy: Path, study: Path) -> bool:
    """Whether a folder's protocol is the study's."""
    try:
        copied, own = (read_bounded(folder / PROTOCOL, _MOST_SETTINGS) for folder in (copy, study))
        return copied == own
    except (HighFiveError, OSError):
        return False


def _mentions(study: Path, code: str) -> tuple[list[str], list[str]]:
    """Files below the study in whose name, or text where they are texts, the code stands by itself; comments in TOML do
    not count. And texts that could not be read."""
    word = re.compile(rb"(?<![A-Za-z0-9])" + re.escape(code.encode()) + rb"(?![A-Za-z0-9])")
    found: list[str] = []
    unread: list[str] = []
    for path in sorted(path for path in study.rglob("*") if os.path.isfile(path)):  # without rights: no file
        name = path.relative_to(study).as_posix()
        try:
            if word.search(os.fsencode(path.name)) or (path.suffix in _TEXTS and word.search(_text(path))):
                found.append(name)
        except (HighFiveError, OSError):  # she is deleted already: what remains is said in any case
            unread.append(name)
    return found, unread


def _text(path: Path) -> bytes:
    content = read_bounded(path, _MOST_TEXT)
    return re.sub(rb"(?m)^\s*#.*$", b"", content) if path.suffix == ".toml" else content
