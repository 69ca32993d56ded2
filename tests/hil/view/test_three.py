"""three.js of the page: one file, made from what docs/three names, with its licence."""

import hashlib
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from paths import ROOT

BUILD, PAGE = ROOT / "docs" / "three", ROOT / "hil" / "view" / "page"


def test_the_licence_is_beside_it_and_it_runs_no_text_as_code() -> None:
    text = (PAGE / "three.js").read_text(encoding="utf-8")
    assert "MIT" in (PAGE / "three-LICENSE.txt").read_text(encoding="utf-8")
    assert text.startswith("/* three.js, MIT licence")
    assert not re.search(r"\beval\(|new Function\(", text)


def test_versions_are_exact() -> None:
    versions = json.loads((BUILD / "package.json").read_text(encoding="utf-8"))["devDependencies"]
    assert all(re.fullmatch(r"\d+\.\d+\.\d+", version) for version in versions.values())


@pytest.mark.slow
def test_the_same_versions_give_the_same_bytes(tmp_path: Path) -> None:
    if shutil.which("npm") is None:
        pytest.skip("no npm here")
    folder = tmp_path / "docs" / "three"
    shutil.copytree(BUILD, folder, ignore=shutil.ignore_patterns("node_modules"))
    (tmp_path / "hil" / "view" / "page").mkdir(parents=True)
    install = ["npm", "install", "--no-audit", "--no-fund", "--no-package-lock"]
    if subprocess.run(install, cwd=folder, capture_output=True, check=False).returncode:
        pytest.skip("npm cannot fetch anything here")
    subprocess.run(["npm", "run", "-s", "build"], cwd=folder, capture_output=True, check=True)
    made = tmp_path / "hil" / "view" / "page" / "three.js"
    assert hashlib.sha256(made.read_bytes()).hexdigest() == hashlib.sha256((PAGE / "three.js").read_bytes()).hexdigest()
