"""``highfive view`` tells who watches a recording that was cut short that it was."""

import json
from pathlib import Path

import pytest
from live_commands import ended, start
from websockets.sync.client import connect

from highfive.hil.view import SHIPPED_RECORDING


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_recording_that_was_cut_short_says_so_on_terminal_and_page(share: float, tmp_path: Path) -> None:
    path, whole = tmp_path / "session.mcap", SHIPPED_RECORDING.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    process, said = start("view", path, "--no-open"), ""
    assert process.stderr is not None
    while "open http" not in said:
        said += (line := process.stderr.readline())
        assert line, said
    address = next(word for word in said.split() if word.startswith("http"))
    with connect(address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None) as link:
        hello = json.loads(link.recv(10.0))
        link.send(json.dumps({"kind": "command", "name": "end"}))
        code, _, err = ended(process)
    assert code == 0 and hello["kind"] == "hello" and hello["cut"] == (share < 1.0)
    assert ("was cut short" in said) == (share < 1.0) and "was cut short" not in err
