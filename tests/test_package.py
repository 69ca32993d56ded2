"""What is installed is one package, and nothing that stands in the way of a user's own modules."""

import os
import shutil
import socket
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from paths import ROOT

import highfive
from highfive.mocap_bridge.files.c3d import write_c3d

MOCAP, WEBCAM, LEROBOT = (ROOT / "packaging" / name for name in ("mocap", "webcam", "lerobot"))
FOLDERS = {"calibration", "hil", "mocap_bridge", "model", "scenes"}


def test_package_links_to_the_folders_of_the_checkout() -> None:
    links = {path.name: os.readlink(path) for path in (ROOT / "highfive").iterdir() if path.is_symlink()}
    assert links == {name: f"../{name}" for name in FOLDERS}
    assert highfive.__version__


def test_all_distributions_have_one_version() -> None:
    versions = [
        tomllib.loads((folder / "pyproject.toml").read_text())["project"]["version"]
        for folder in (ROOT, MOCAP, WEBCAM, LEROBOT)
    ]
    assert len(set(versions)) == 1
    assert f"version: {versions[0]}" in (ROOT / "CITATION.cff").read_text()
    assert f"version = {{{versions[0]}}}" in (ROOT / "docs" / "index.md").read_text()


def wheel_of(folder: Path, tmp_path: Path) -> Path:
    """The wheel that a folder of the tree builds."""
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    tree = tmp_path / "tree"  # setuptools leaves a build/ behind, and takes what lies there for built
    if not tree.exists():
        left_out = shutil.ignore_patterns(".*", "build", "out", "__pycache__", "*.egg-info")
        shutil.copytree(ROOT, tree, symlinks=True, ignore=left_out)
    wheels = tmp_path / f"wheels-{folder.name}"
    place = str(tree / folder.relative_to(ROOT))
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", str(wheels), place], check=True)
    (wheel,) = wheels.glob("*.whl")
    return wheel


def with_machine_code(package: Path) -> None:
    """Gives a package of the same sources the machine code that this tree has: it says itself if it does not fit."""
    for kind in ("nbi", "nbc"):
        for kept in ROOT.glob(f"*/**/__pycache__/*.{kind}"):
            source = package / kept.relative_to(ROOT)
            if source.parents[1].is_dir():
                source.parent.mkdir(exist_ok=True)
                shutil.copy(kept, source)


@pytest.mark.slow
def test_the_bridge_alone_tracks_a_file(tmp_path: Path) -> None:
    write_c3d(tmp_path / "person.c3d", highfive.simulated_person("happy", "B2").recording)
    wheel = wheel_of(MOCAP, tmp_path)
    with zipfile.ZipFile(wheel) as content:
        assert not any(name.startswith(("highfive/hil", "highfive/scenes")) for name in content.namelist())
        assert not any(name.endswith(".safetensors") for name in content.namelist())
        content.extractall(tmp_path / "site")
    with_machine_code(tmp_path / "site" / "highfive")
    code = (
        f"import sys; sys.path.insert(1, {str(tmp_path / 'site')!r}); import highfive; "
        "print(highfive.__file__, len(highfive.track('person.c3d')), {'mujoco', 'jax', 'typer'} & set(sys.modules))\n"
        "try: highfive.open_session\nexcept ImportError as error: print(error)"
    )
    script = [sys.executable, "-S", "-c", _with_libraries(code)]
    done = subprocess.run(script, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    assert first.startswith(str(tmp_path / "site"))
    assert first.endswith("set()")
    assert second == "highfive.open_session is not part of high-five-mocap; pip install high-five"


def _with_libraries(code: str) -> str:
    """Code with this environment's libraries, but without its editable installation of this project."""
    places = [path for path in sys.path if path.endswith("site-packages")]
    return f"import sys; sys.path += {places!r}; {code}"


@pytest.mark.slow(30)
def test_installed_wheel_plays_and_its_examples_run_beside_a_users_own_modules(tmp_path: Path) -> None:
    """In an environment of its own, whose libraries are this one's: what is installed is the wheel alone."""
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path / "venv")], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    pip = [str(python), "-m", "pip", "--quiet", "--disable-pip-version-check", "install", "--no-deps"]
    subprocess.run([*pip, str(wheel_of(ROOT, tmp_path))], check=True)
    (site,) = (tmp_path / "venv" / "lib").glob("python*/site-packages")
    libraries = [path for path in sys.path if path.endswith("site-packages")]
    (site / "libraries.pth").write_text("\n".join(libraries) + "\n")  # of added folders no .pth files are read
    with_machine_code(site / "highfive")
    (tmp_path / "model.py").write_text("MINE = True\n")
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "__init__.py").write_text("MINE = True\n")
    code = "import model, scenes, highfive; assert model.MINE and scenes.MINE; print(highfive.__file__)"
    script = [str(python), "-c", code]
    where = subprocess.run(script, cwd=tmp_path, check=True, capture_output=True, text=True)
    assert where.stdout.startswith(str(site))
    command = [
        str(tmp_path / "venv" / "bin" / "highfive"),
        "simulate",
        "--trials",
        "1",
        "--no-pictures",
        "--out",
        "out",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for example, arguments in (("respond.py", []), ("style_blend.py", []), ("read_session.py", ["out/session.mcap"])):
        script = [str(python), str(ROOT / "examples" / example), *arguments]
        done = subprocess.run(script, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_example_package_is_installed_and_streamed_from(tmp_path: Path) -> None:
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "install", "--no-deps"]
    shutil.copytree(ROOT / "examples" / "lab_source", tmp_path / "lab_source")
    subprocess.run([*pip, "--target", str(tmp_path / "site"), str(tmp_path / "lab_source")], check=True)
    write_c3d(tmp_path / "person.c3d", highfive.simulated_person("happy", "B2").recording)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    code = (
        "import sys, time, highfive\n"
        f"source = highfive.open_source('lab://127.0.0.1:{port}')\n"
        "frame = source.first(30.0)\nprint(frame.valid.sum(), len(frame.names))\nsource.close()"
    )
    listener = subprocess.Popen(
        [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True, cwd=tmp_path
    )
    sender = [sys.executable, str(ROOT / "examples/lab_source/send.py"), "person.c3d", "127.0.0.1", str(port)]
    while listener.poll() is None:
        subprocess.run(sender, cwd=tmp_path, check=True)
    seen, names = map(int, (listener.stdout.read() if listener.stdout else "").split())
    assert listener.returncode == 0
    assert 0 < seen <= names


@pytest.mark.slow
def test_wheel_holds_one_top_level_package_and_all_its_files(tmp_path: Path) -> None:
    wheel = wheel_of(ROOT, tmp_path)
    names = set(zipfile.ZipFile(wheel).namelist())
    files = (path.relative_to(ROOT) for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file())
    ours = {f"highfive/{path}" for path in files if "__pycache__" not in path.parts}
    assert {name for name in names if ".dist-info/" not in name} == ours | {"highfive/__init__.py", "highfive/py.typed"}
    licences = {name.partition("/licenses/")[2] for name in names if "/licenses/" in name}
    assert licences == {"LICENSE", "NOTICE", "highfive/hil/view/page/three-LICENSE.txt"}
