"""``highfive rig reach``: where its map goes."""

import json
from pathlib import Path

import pytest
from command_line import running

run = running("rig", "reach")


@pytest.mark.slow(30)
def test_the_map_goes_to_a_folder_of_results(run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out" / "reach-1").mkdir(parents=True)
    code, out, _ = run("--arm", "openmanipulator_x", "--json")
    assert code == 0 and json.loads(out)["picture"] == "out/reach-2/reach.png"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert (tmp_path / "out" / "reach-2" / "reach.png").is_file()
