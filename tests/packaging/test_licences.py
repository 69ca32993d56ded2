"""Whatever our packages hold of others is listed, its licence comes along, and nothing installed is under the GPL."""

import json
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from paths import ROOT

sys.path.insert(0, str(ROOT / "packaging"))
import licences
from runtime import closure, project

FOLDERS = ("calibration", "hil", "mocap_bridge", "model", "scenes", "highfive", "packaging/lerobot", "packaging/webcam")
CONTENT = tomllib.loads((ROOT / "packaging" / "third_party.toml").read_text(encoding="utf-8"))
SOMEBODYS = re.compile(r"copyright\b|\(c\) \d{4}|©|SPDX-License|@license|licen[cs]ed under", re.IGNORECASE)
LONGEST_LINE = 1000


def shipped() -> Iterator[Path]:
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*"):
            left = {"__pycache__", "build"} & set(path.relative_to(ROOT).parts)  # by Python, and by `make webcam`
            if path.is_file() and not path.is_symlink() and not left:
                yield path.relative_to(ROOT)


def not_written_by_hand(path: Path) -> bool:
    """Somebody's name in it, no text, or lines that nobody types."""
    try:
        text = (ROOT / path).read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return True
    return bool(SOMEBODYS.search(text)) or max(map(len, text.splitlines() or [""])) > LONGEST_LINE


def test_every_file_that_is_not_written_here_is_listed() -> None:
    listed = [file for kind in ("bundled", "made") for one in CONTENT[kind] for file in one["files"]]
    texts = {one["text"] for one in CONTENT["bundled"]} | {"packaging/webcam/high_five_webcam/LICENSE"}
    left = [
        path.as_posix()
        for path in shipped()
        if not_written_by_hand(path) and path.as_posix() not in texts and not any(map(path.match, listed))
    ]
    assert not left
    found = set(shipped())
    for one in CONTENT["made"] + [one for one in CONTENT["bundled"] if one["package"] == "high-five"]:
        for pattern in one["files"]:
            assert any(path.match(pattern) for path in found), pattern


@pytest.mark.parametrize("text", ["// Copyright 2020 A. N. Other", '"""Ported, licensed under the MIT."""', "x" * 2000])
def test_what_is_not_ours_is_found(text: str, tmp_path: Path) -> None:
    (tmp_path / "file.js").write_text(text)
    assert not_written_by_hand(tmp_path / "file.js")
    (tmp_path / "net.bin").write_bytes(b"\xff\xfe\x00")
    assert not_written_by_hand(tmp_path / "net.bin")
    (tmp_path / "ours.py").write_text('"""Ours."""\n')
    assert not not_written_by_hand(tmp_path / "ours.py")


def test_versions_are_those_that_are_bundled_and_texts_come_along() -> None:
    versions = {one["name"]: one["version"] for one in CONTENT["bundled"]}
    made_of = json.loads((ROOT / "docs/three/package.json").read_text())["devDependencies"]["three"]
    assert versions["three.js"] == made_of
    fetched = (ROOT / "packaging/webcam/fetch.py").read_text()
    for name in ("pose", "hands"):
        assert f"@mediapipe/{name}@{versions[f'MediaPipe {name.capitalize()}']}" in fetched
    files = project()["license-files"]
    assert isinstance(files, list)
    for one in CONTENT["bundled"]:
        assert one["purl"].endswith(f"@{one['version']}")
        assert (ROOT / one["text"]).is_file()
        if one["package"] == "high-five":
            assert f"highfive/{one['text']}" in files
            assert one["version"] in (ROOT / "NOTICE").read_text()


def test_all_that_is_installed_is_permissive_and_in_the_documentation() -> None:
    packages = closure(list(project()["dependencies"]))  # pyright: ignore[reportArgumentType]
    assert {"numpy", "mujoco", "lz4"} <= {one.name for one in packages}  # what brings what, too
    assert not licences.not_taken(packages)
    page = licences.PAGE.read_text(encoding="utf-8")
    if sys.version_info[:2] == (3, 11) and sys.platform == "linux":
        assert licences.filled(page, packages) == page, "make licences"


@pytest.mark.parametrize("licence", ["GPL-3.0-or-later", "MIT AND LGPL-2.1", "", "Proprietary"])
def test_other_licences_are_refused(licence: str) -> None:
    assert licences.not_taken([licences.Package("other", "1.0", licence, ())])
