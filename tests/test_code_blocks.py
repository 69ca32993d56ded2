"""What pages show of Python runs as it stands there, in their order."""

import re
import shutil
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from paths import ROOT

import highfive
from highfive.hil.view import SHIPPED_RECORDING
from highfive.mocap_bridge.files.c3d import write_c3d

BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
NEEDS = ("vicon://", "highfive.train", "/lsl/EEG", "Synchroniser(")
"""What is not at hand here: a system, minutes of training, a stream that somebody recorded, other threads."""


@pytest.mark.parametrize("page", ["README.md", "docs/library.md", "docs/recordings.md", "docs/style.md"])
@pytest.mark.slow
def test_blocks_of_a_page_run(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out/session-1").mkdir(parents=True)
    shutil.copy(SHIPPED_RECORDING, tmp_path / "out/session-1/session.mcap")
    person = highfive.simulated_person("happy", "B2")
    write_c3d(tmp_path / "recording.c3d", person.recording)
    known = {"highfive": highfive, "np": np, "hand_points": np.array([[0.9, 0.0, 1.0], [0.85, 0.0, 1.05]])}
    blocks: list[str] = BLOCK.findall((ROOT / page).read_text(encoding="utf-8"))
    run = [block for block in blocks if not any(word in block for word in NEEDS)]
    assert run
    for block in run:
        here = block if find_spec("pandas") else "".join(re.findall(r"^(?!.*\.table\().*\n", block, re.MULTILINE))
        exec(compile(here, page, "exec"), known)


def test_all_blocks_are_python() -> None:
    blocks = [
        (path, block)
        for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
        for block in BLOCK.findall(path.read_text(encoding="utf-8"))
    ]
    assert len(blocks) > 14
    for path, block in blocks:
        compile(block, str(path), "exec")
