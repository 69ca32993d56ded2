"""What is installed is one package, and nothing that stands in the way of a user's own modules."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from paths import ROOT

import highfive

FOLDERS = {"calibration", "hil", "mocap_bridge", "model", "scenes"}


def test_package_links_to_the_folders_of_the_checkout() -> None:
    links = {path.name: os.readlink(path) for path in (ROOT / "highfive").iterdir() if path.is_symlink()}
    assert links == {name: f"../{name}" for name in FOLDERS}
    assert highfive.__version__


@pytest.mark.slow
def test_wheel_holds_one_top_level_package_and_all_its_files(tmp_path: Path) -> None:
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    tree = tmp_path / "tree"  # setuptools leaves a build/ behind, and takes what lies there for built
    left_out = shutil.ignore_patterns(".*", "build", "out", "__pycache__", "*.egg-info")
    shutil.copytree(ROOT, tree, symlinks=True, ignore=left_out)
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", str(tmp_path), str(tree)], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {name.partition("/")[0] for name in names if ".dist-info/" not in name} == {"highfive"}
    files = (path.relative_to(ROOT) for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file())
    assert {f"highfive/{path}" for path in files if "__pycache__" not in path.parts} <= names
    # A user's own model.py and scenes/ are what they import, and the project works beside them.
    (tmp_path / "model.py").write_text("MINE = True\n")
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "__init__.py").write_text("MINE = True\n")
    code = (
        f"import sys; sys.path.insert(1, {str(wheel)!r}); import model, scenes; assert model.MINE and scenes.MINE; "
        "import highfive.model; print(highfive.model.__file__)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert str(wheel) in done.stdout
