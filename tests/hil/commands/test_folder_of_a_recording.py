"""A folder that holds one recording stands for it, in every command that opens one."""

import json
import shutil
from pathlib import Path

import pytest
from command_line import failing, running

from highfive.hil.recording.recording import read_recording
from highfive.hil.view import SHIPPED_RECORDING

run, fails = running(), failing()
COMMANDS = {
    "view": lambda folder: ("view", folder, "--no-open"),
    "rig play": lambda folder: ("rig", "play", folder),
    "export": lambda folder: ("export", folder, "--to", "csv"),
    "calibrate event": lambda folder: ("calibrate", "event", folder, "--stream", "arm", "--reference", "person"),
    "simulate": lambda folder: ("simulate", "--source", folder),
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Whose only recording has a name of its own, and lies deeper."""
    monkeypatch.chdir(tmp_path)
    deeper = tmp_path / "participant 3" / "morning"
    deeper.mkdir(parents=True)
    (deeper / ".highfive-left-session.mcap").touch()  # a killed session's
    shutil.copy(SHIPPED_RECORDING, deeper / "block-1.mcap")
    return deeper.parent


@pytest.mark.parametrize("command", COMMANDS)
def test_one_without_a_recording_or_with_several_is_one_line(command: str, run, folder: Path) -> None:
    def said() -> str:
        code, out, err = run(*COMMANDS[command](folder))
        assert code == 2 and out == "" and err.count("error:") == 1
        return err.splitlines()[-1]

    recording = folder / "morning" / "block-1.mcap"
    shutil.copy(recording, folder / "block-2.mcap")
    assert "is a folder of 2 recordings; give one of them: block-2.mcap, morning/block-1.mcap" in said()
    recording.unlink()
    (folder / "block-2.mcap").unlink()
    assert "is a folder without a recording; expected an .mcap file in it" in said()
    assert [path.name for path in folder.parent.rglob("*.*")] == [".highfive-left-session.mcap"]


def test_it_is_exported_beside_its_recording(run, folder: Path) -> None:
    code, out, _ = run("export", folder, "--to", "npz", "--json")
    assert code == 0 and json.loads(out)["files"] == [str(folder / "morning" / "block-1.npz")]


@pytest.mark.slow
def test_its_recording_is_opened(fails, folder: Path) -> None:
    assert "person: the recording has no stream person; it has none" in fails(*COMMANDS["calibrate event"](folder))
    assert "is seen with: highfive view" in fails(*COMMANDS["simulate"](folder), "--view")
    assert read_recording(folder).settings == read_recording(SHIPPED_RECORDING).settings
