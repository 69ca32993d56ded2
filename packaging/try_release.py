"""Tries the wheels in ``dist/`` as a user would: a new environment for each Python, an empty folder, no checkout.

``python packaging/try_release.py [--python PATH]... [--extras NAME,...] [--dist DIR] [--work DIR]``. Each environment
gets the wheel with ``constraints.txt``, then ``pip check``, ``highfive --help``, ``highfive demo`` and each extra,
which is used once. Prints a table; exit code 1 if anything fails.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VERSIONS = ("3.11", "3.12", "3.13")
# What shows that an extra works: words of a command in the environment, after the demo, in its folder.
EXTRAS: dict[str, list[str]] = {
    "tables": [
        "python", "-c", "import highfive; print(highfive.read_recording('out/session-1').table('/tick').shape)",
    ],
    "foxglove": [
        "highfive", "simulate", "--trials", "1", "--no-pictures", "--publish", "foxglove", "--out", "out/foxglove",
    ],
    "webcam": ["python", "-c", "from highfive.hil.view.webcam_files import net_files; print(len(net_files()))"],
    "peers": ["python", "-c", "import GPy; print(GPy.__version__)"],
}  # fmt: skip


@dataclass
class Row:
    """What one Python came to. Times are wall clock and processor, s."""

    python: str
    installed: str = ""
    megabytes: float = 0.0
    demo: str = ""
    extras: dict[str, str] = field(default_factory=dict)
    failed: bool = False


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--python", action="append", help="an interpreter (default: each of 3.11, 3.12, 3.13 here)")
    parser.add_argument("--extras", default=",".join(EXTRAS), help=f"of {', '.join(EXTRAS)}, with commas between")
    parser.add_argument("--dist", type=Path, default=ROOT / "dist")
    parser.add_argument("--work", type=Path, help="a folder for the environments that stays (default: one that goes)")
    options = parser.parse_args()
    extras = [name for name in options.extras.split(",") if name]
    dist: Path = options.dist.resolve()
    wheels = list(dist.glob("high_five-*.whl"))
    if len(wheels) != 1:
        raise SystemExit(f"{dist} holds {len(wheels)} wheels of high-five and not one: make dist")
    rows = []
    with tempfile.TemporaryDirectory() as place:
        for python in options.python or pythons():
            row = tried(python, wheels[0], extras, (options.work or Path(place)).resolve())
            print(as_lines([row])[-1], flush=True, file=sys.stderr)
            rows.append(row)
    print("\n".join(as_lines(rows)))
    if not rows or any(row.failed for row in rows):
        raise SystemExit(1)


def pythons() -> list[str]:
    """Those of this computer, by ``PATH`` or pyenv."""
    found = []
    for version in VERSIONS:
        kept = sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))
        path = str(kept[-1]) if kept else shutil.which(f"python{version}")
        if path is None:
            print(f"warning: no Python {version} here", file=sys.stderr)
        else:
            found.append(path)
    return found


def tried(python: str, wheel: Path, extras: Sequence[str], place: Path) -> Row:
    """One Python, in new folders below ``place``."""
    version = said([python, "--version"], place.parent).split()[-1]
    row = Row(version)
    home, folder = place / f"env-{version}", place / f"empty-{version}"
    folder.mkdir(parents=True)
    said([python, "-m", "venv", str(home)], folder)
    install = [
        str(home / "bin" / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
        "--constraint", str(ROOT / "constraints.txt"), "--find-links", str(wheel.parent),
    ]  # fmt: skip
    try:
        row.installed = taken([*install, str(wheel)], folder)
        row.megabytes = size(home)
        said([str(home / "bin" / "highfive"), "--help"], folder)
        said([*install[:3], "check"], folder)
        row.demo = taken([str(home / "bin" / "highfive"), "demo", "--no-open"], folder)
        if not (folder / "out" / "session-1" / "report.html").is_file():
            raise RuntimeError("highfive demo left no report")
    except RuntimeError as error:
        row.failed, row.demo = True, row.demo or f"failed: {error}"
        return row
    for extra in extras:
        words = EXTRAS[extra]
        if extra == "webcam" and not list(wheel.parent.glob("high_five_webcam-*.whl")):
            row.extras[extra] = "not in dist/: make webcam, make dist"
            continue
        try:
            before = size(home)
            said([*install, f"{wheel}[{extra}]"], folder)
            added = size(home) - before
            said([*install[:3], "check"], folder)
            said([str(home / "bin" / words[0]), *words[1:]], folder)
            row.extras[extra] = f"+{added:.0f} MB"
        except RuntimeError as error:
            row.failed, row.extras[extra] = True, f"failed: {error}"
    return row


def taken(command: Sequence[str], folder: Path) -> str:
    """Runs it; how long it took."""
    start, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
    said(command, folder)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return f"{time.monotonic() - start:.0f} s ({processor:.0f} s)"


def said(command: Sequence[str], folder: Path) -> str:
    """Runs it without this checkout's surroundings; its standard output.

    Raises:
        RuntimeError: it fails; with the last line that it said.
    """
    surroundings = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(command, cwd=folder, env=surroundings, capture_output=True, text=True, check=False)
    if done.returncode:
        lines = (done.stderr.strip() or done.stdout.strip() or "nothing said").splitlines()
        raise RuntimeError(f"{Path(command[0]).name} {' '.join(command[1:4])}: {lines[-1]}")
    return done.stdout


def size(home: Path) -> float:
    """Of an environment, MB, as its files are long; what Python compiles is left out."""
    files = (path for path in home.rglob("*") if path.is_file() and not path.is_symlink())
    return sum(path.stat().st_size for path in files if "__pycache__" not in path.parts) / 1e6


def as_lines(rows: Sequence[Row]) -> list[str]:
    """A table in Markdown."""
    extras = list(dict.fromkeys(name for row in rows for name in row.extras))
    heads = ["Python", "install, wall (processor)", "MB", "highfive demo, the first", *extras]
    lines = [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}"]
    for row in rows:
        cells = [row.python, row.installed, f"{row.megabytes:.0f}", row.demo, *(row.extras.get(e, "") for e in extras)]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


if __name__ == "__main__":
    main()
