"""Builds the release into ``dist/``: the same commit gives the same bytes.

``python packaging/dist.py [--check] [OUT]``. What is built is the last commit, not what lies in the folder: a wheel and
a source distribution of High Five, of the bridge alone and of the plug-in for lerobot, and, where ``make webcam`` has
fetched the nets, of the nets; and the bill of materials (packaging/sbom.py). ``--check`` builds all twice, and each
wheel from the checkout as well as from the source distribution, and compares.
"""

from __future__ import annotations

import argparse
import gzip
import hashlib
import io
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = (".", "packaging/mocap", "packaging/lerobot")
WEBCAM = "packaging/webcam"
SUMS = "SHA256SUMS"
BILL = ".cdx.json"


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", nargs="?", type=Path, default=ROOT / "dist")
    parser.add_argument("--check", action="store_true", help="build twice and compare")
    options = parser.parse_args()
    if git("status", "--porcelain").strip():
        print("warning: what is not committed is not built", file=sys.stderr)
    with tempfile.TemporaryDirectory() as place:
        built = build(Path(place) / "first")
        if options.check:
            compare(built, Path(place))
        options.out.mkdir(parents=True, exist_ok=True)
        for path in built:
            shutil.copy(path, options.out / path.name)
        sums = [f"{digest(path)}  {path.name}\n" for path in built]
        (options.out / SUMS).write_text("".join(sums), encoding="utf-8")
    print("".join(sums), end="")


def build(place: Path) -> list[Path]:
    """Wheels and source distributions of the last commit, sorted; ``place`` is a new folder for the work."""
    tree, epoch = exported(place / "tree"), int(git("log", "-1", "--format=%ct"))
    folders = [*FOLDERS, *([WEBCAM] if with_nets(tree) else [])]
    for folder in folders:
        run_build(tree / folder, place / "built", epoch)
    for source in (place / "built").glob("*.tar.gz"):
        source.write_bytes(stamped(source.read_bytes(), epoch))
    (wheel,) = (place / "built").glob("high_five-*.whl")
    bill = [str(tree / "packaging" / "sbom.py"), str(wheel), str(wheel.with_name(wheel.name.split("-py3")[0] + BILL))]
    subprocess.run([sys.executable, *bill], env={**os.environ, "SOURCE_DATE_EPOCH": str(epoch)}, check=True)
    return sorted((place / "built").iterdir())


def exported(tree: Path) -> Path:
    """The last commit as a folder: the modes do not depend on this user's."""
    archive = subprocess.run(
        ["git", "-c", "tar.umask=0022", "archive", "HEAD"], cwd=ROOT, check=True, stdout=subprocess.PIPE
    ).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as content:
        content.extractall(tree, filter="fully_trusted")  # ours, with links
    return tree


def with_nets(tree: Path) -> bool:
    """Whether the webcam's nets have been fetched here; puts them into the tree, each held to its SHA-256 again."""
    package = Path(WEBCAM) / "high_five_webcam"
    if not (ROOT / package / "pose").is_dir():
        print("warning: no webcam nets here, so no high-five-webcam: make webcam fetches them", file=sys.stderr)
        return False
    for folder in ("pose", "hands"):
        shutil.copytree(ROOT / package / folder, tree / package / folder)
    subprocess.run([sys.executable, str(tree / WEBCAM / "fetch.py")], check=True)
    return True


def run_build(folder: Path, out: Path, epoch: int, *more: str) -> None:
    """Source distribution, and the wheel from that, as anybody would build them, by the pinned setuptools."""
    surroundings = {**os.environ, "SOURCE_DATE_EPOCH": str(epoch), "PIP_CONSTRAINT": str(ROOT / "constraints.txt")}
    command = [sys.executable, "-m", "build", "--outdir", str(out), *more, str(folder)]
    done = subprocess.run(
        command, env=surroundings, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
    )
    if done.returncode:
        raise SystemExit(f"{folder} cannot be built:\n{done.stdout}")


def stamped(archive: bytes, epoch: int) -> bytes:
    """A ``.tar.gz`` whose every file is of the commit's time and of nobody: setuptools leaves the time of building."""
    plain = io.BytesIO()
    with (
        tarfile.open(fileobj=io.BytesIO(archive)) as before,
        tarfile.open(fileobj=plain, mode="w", format=tarfile.PAX_FORMAT) as after,
    ):
        for member in sorted(before.getmembers(), key=lambda one: one.name):
            member.mtime, member.uid, member.gid, member.uname, member.gname = epoch, 0, 0, "", ""
            member.mode, member.pax_headers = 0o755 if member.isdir() else 0o644, {}
            after.addfile(member, before.extractfile(member) if member.isfile() else None)
    packed = io.BytesIO()
    with gzip.GzipFile("", "wb", compresslevel=9, fileobj=packed, mtime=epoch) as stream:
        stream.write(plain.getvalue())
    return packed.getvalue()


def compare(built: list[Path], place: Path) -> None:
    """Ends with what differs, if anything does, in a second build and in wheels that are made without the sources."""
    again = build(place / "second")
    tree, epoch, direct = place / "third", int(git("log", "-1", "--format=%ct")), place / "direct"
    exported(tree)
    for folder in [*FOLDERS, *([WEBCAM] if with_nets(tree) else [])]:
        run_build(tree / folder, direct, epoch, "--wheel")
    ours = {path.name: path for path in built}
    wrong = [f"{path.name} differs in the second build" for path in again if not same(path, ours[path.name])]
    wrong += [
        f"{path.name} from the checkout differs from the one from the source distribution: {difference(path, other)}"
        for path in sorted(direct.glob("*.whl"))
        if not same(path, other := ours[path.name])
    ]
    if wrong:
        raise SystemExit("\n".join(wrong))
    print(f"{len(again)} files built twice, {len(list(direct.glob('*.whl')))} wheels in two ways: the same bytes")


def same(one: Path, other: Path) -> bool:
    """Bit by bit."""
    return one.read_bytes() == other.read_bytes()


def difference(one: Path, other: Path) -> str:
    """Names of files that only one of two wheels has, or that are other ones."""
    with zipfile.ZipFile(one) as first, zipfile.ZipFile(other) as second:
        sizes = [
            {(file.filename, file.CRC, file.external_attr) for file in wheel.infolist()} for wheel in (first, second)
        ]
    return ", ".join(sorted({name for name, *_ in sizes[0] ^ sizes[1]})[:10]) or "order"


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def git(*words: str) -> str:
    """What git says."""
    return subprocess.run(["git", *words], cwd=ROOT, check=True, capture_output=True, text=True).stdout


if __name__ == "__main__":
    main()
