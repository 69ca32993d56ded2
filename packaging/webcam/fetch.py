"""Fetches the nets with npm by pinned version, compares each file with its SHA-256, and puts them into the package.

``python packaging/webcam/fetch.py [FOLDER]``; the folder is that of the package, next to this file, unless given.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
PACKAGE = HERE / "high_five_webcam"
PINNED = {"pose": "@mediapipe/pose@0.5.1675469404", "hands": "@mediapipe/hands@0.4.1675469240"}


def fetch(folder: Path) -> None:
    """Makes ``folder`` the whole package; what is there already and right is kept.

    Raises:
        SystemExit: npm is not here or cannot fetch, or a file is another one.
    """
    listed: dict[str, str] = json.loads((PACKAGE / "files.json").read_text(encoding="utf-8"))
    folder.mkdir(parents=True, exist_ok=True)
    if folder != PACKAGE:
        for name in ("__init__.py", "files.json"):
            shutil.copy(PACKAGE / name, folder / name)
    shutil.copy(HERE.parents[1] / "LICENSE", folder / "LICENSE")  # Apache-2.0, which is theirs, too
    for kind, package in PINNED.items():
        wanted = {name: digest for name, digest in listed.items() if name.startswith(f"{kind}/")}
        if not all(_is(folder / name, digest) for name, digest in wanted.items()):
            _unpack(package, folder, wanted)


def _unpack(package: str, folder: Path, wanted: dict[str, str]) -> None:
    npm = shutil.which("npm")
    if npm is None:
        raise SystemExit("npm is not installed: it fetches the webcam's nets (Debian: apt install npm)")
    with tempfile.TemporaryDirectory() as place:
        done = subprocess.run(
            [npm, "pack", "--silent", package], cwd=place, capture_output=True, text=True, check=False
        )
        archives = list(Path(place).glob("*.tgz"))
        if done.returncode or len(archives) != 1:
            said = " ".join((done.stderr or done.stdout).split())[:200]
            raise SystemExit(f"npm cannot fetch {package}: {said}")
        with tarfile.open(archives[0]) as archive:
            for name, digest in wanted.items():
                member = archive.extractfile(f"package/{name.partition('/')[2]}")
                data = b"" if member is None else member.read()
                if hashlib.sha256(data).hexdigest() != digest:
                    raise SystemExit(f"{name} of {package} is another file than was pinned")
                (folder / name).parent.mkdir(exist_ok=True)
                (folder / name).write_bytes(data)


def _is(path: Path, digest: str) -> bool:
    return path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == digest


if __name__ == "__main__":
    fetch(Path(sys.argv[1]) if len(sys.argv) > 1 else PACKAGE)
