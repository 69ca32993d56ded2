"""One concept a file: none grows beyond what can be read at a sitting."""

from pathlib import Path

import pytest
from paths import ROOT

MOST_LINES = 400
ROOMS = ("calibration", "hil", "mocap_bridge", "model", "scenes")
BUNDLED = {Path("hil/view/page/three.js")}
"""Somebody else's, in one file."""


@pytest.mark.parametrize("room", ROOMS)
def test_no_file_is_longer_than_can_be_read_at_a_sitting(room: str) -> None:
    found = [path for kind in ("*.py", "*.js") for path in (ROOT / room).rglob(kind)]
    assert found
    long = {
        str(path.relative_to(ROOT)): lines
        for path in found
        if path.relative_to(ROOT) not in BUNDLED
        and (lines := len(path.read_text(encoding="utf-8").splitlines())) > MOST_LINES
    }
    assert not long
