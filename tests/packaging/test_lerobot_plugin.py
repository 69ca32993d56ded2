"""lerobot itself reads our datasets and leads the arm: ``make lerobot`` installs it in an environment of its own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.cli import main as cli
from highfive.hil.view import SHIPPED_RECORDING

PYTHON = os.environ.get("LEROBOT_PYTHON", "")
pytestmark = [
    pytest.mark.slow(seconds=40),
    pytest.mark.skipif(not PYTHON, reason="LEROBOT_PYTHON names no Python that has lerobot (make lerobot)"),
]
HIGHFIVE = str(Path(sys.executable).with_name("highfive"))
ROBOT = """
from lerobot.robots import RobotConfig, make_robot_from_config
from lerobot.utils.import_utils import register_third_party_plugins
register_third_party_plugins()
def robot(**options):
    return make_robot_from_config(RobotConfig.get_choice_class("high_five")(highfive=HIGHFIVE, **options))
"""


def in_lerobot(script: str, *words: object) -> str:
    """What a script says that lerobot's Python runs."""
    script = f"import json, sys\nHIGHFIVE = {HIGHFIVE!r}\n{ROBOT}\n{script}"
    run = subprocess.run(
        [PYTHON, "-c", script, *map(str, words)],
        capture_output=True, text=True, check=False, env=os.environ | {"HF_HUB_OFFLINE": "1"},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return run.stdout


def highfive(monkeypatch: pytest.MonkeyPatch, *words: object) -> None:
    monkeypatch.setattr("sys.argv", ["highfive", *map(str, words)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert not end.value.code


@pytest.mark.parametrize("arm", ["vx300s", "koch_v1_1"])
def test_lerobot_finds_the_plug_in_and_leads_the_arm(arm: str) -> None:
    said = in_lerobot(
        """
arm = robot(port="virtual", arm=sys.argv[1])
features = list(arm.observation_features), list(arm.action_features)
with arm:
    before, last = arm.get_observation(), features[1][-1]
    for n in range(40):
        sent = arm.send_action({last: before[last] + 0.5 * n})
    for n in range(10):
        after = arm.get_observation()
    errors = []
    for wrong in ({"gripper.pos": 1.0}, {last: float("nan")}):
        try:
            arm.send_action(wrong)
        except ValueError as error:
            errors.append(str(error))
    connected = arm.is_connected
print(json.dumps([features, before, sent, after, errors, connected, arm.is_connected]))
""",
        arm,
    )
    (seen, done), before, sent, after, errors, connected, still = json.loads(said.splitlines()[-1])
    assert seen == done == [f"{name}.pos" for name in find_arm(arm).names]
    last = done[-1]
    assert sent[last] == pytest.approx(before[last] + 19.5, abs=0.01)
    assert after[last] == pytest.approx(sent[last], abs=0.5)
    assert len(errors) == 2 and "no joint gripper" in errors[0] and connected and not still


def test_what_is_refused_says_what_to_say_to_lerobot() -> None:
    said = in_lerobot(
        """
for options in ({"port": "/dev/ttyUSB9"}, {"port": "/dev/ttyUSB9", "armed": True}, {"faults": ["dead=3@4"]}):
    arm = robot(**{"port": "virtual", **options})
    try:
        arm.connect()
        for n in range(300):
            arm.send_action({"waist.pos": 0.1 * n})
    except ConnectionError as error:
        print(str(error))
    arm.disconnect()
"""
    ).splitlines()
    assert "only with --robot.armed=true" in said[0]
    assert "--robot.nobody_near=true" in said[1]
    assert "stopped" in said[2] or "answered" in said[2]


def test_lerobot_loads_our_dataset_and_replays_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A session with an arm, exported, loaded, its numbers as lerobot's own; and the arm goes along with it again."""
    highfive(monkeypatch, "simulate", "--trials", 2, "--rig", "virtual", "--seed", 3, "--out", tmp_path / "s")
    highfive(monkeypatch, "export", tmp_path / "s", "--to", "lerobot", "--out", tmp_path / "d")
    said = in_lerobot(
        """
import numpy as np
from lerobot.datasets.compute_stats import aggregate_stats, compute_episode_stats
from lerobot.datasets.lerobot_dataset import LeRobotDataset
data = LeRobotDataset("high/five", root=sys.argv[1])
assert data.num_episodes == 2 and len(data) == data.num_frames and data[5]["task"] and data.fps == 30
window = LeRobotDataset("high/five", root=sys.argv[1], episodes=[1], delta_timestamps={"action": [0.0, 1 / 30, 2 / 30]})
assert window[3]["action"].shape == (3, 6)
features, each = data.meta.features, []
for episode in data.meta.episodes:
    rows = [data.hf_dataset[n] for n in range(episode["dataset_from_index"], episode["dataset_to_index"])]
    columns = {key: np.stack([np.asarray(row[key]) for row in rows]) for key in features}
    each.append(compute_episode_stats(columns, features))
for key, found in aggregate_stats(each).items():
    for what in ("min", "max", "mean", "std", "count"):
        ours = np.asarray(data.meta.stats[key][what], float)
        assert ours.shape == found[what].shape and np.allclose(ours, found[what], rtol=1e-3, atol=2e-3), (key, what)
rows = [data[n] for n in range(data.meta.episodes[0]["dataset_to_index"])]
names, off = features["action"]["names"], []
with robot(port="virtual") as arm:
    first = dict(zip(names, rows[0]["action"].tolist()))
    for n in range(90):
        arm.send_action(first)
    for row, later in zip(rows, rows[2:]):
        arm.send_action(dict(zip(names, row["action"].tolist())))
        seen = arm.get_observation()  # a line takes 1/30 s in virtual time: after two of them, two frames later
        off.append(max(abs(seen[name] - there) for name, there in zip(names, row["observation.state"].tolist())))
print(json.dumps([float(np.median(off)), float(np.max(off))]))
""",
        tmp_path / "d",
    )
    median, worst = json.loads(said.splitlines()[-1])
    print(median, worst)
    assert median < 1.0 and worst < 8.0  # degrees, at up to 180 a second


def test_the_shipped_recording_is_a_dataset_of_the_avatar(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    highfive(monkeypatch, "export", SHIPPED_RECORDING, "--to", "lerobot", "--out", tmp_path / "d")
    said = in_lerobot(
        """
from lerobot.datasets.lerobot_dataset import LeRobotDataset
data = LeRobotDataset("high/five", root=sys.argv[1])
print(data.num_episodes, data.meta.robot_type, data[0]["observation.state"].shape[0])
""",
        tmp_path / "d",
    )
    assert said.split()[-3:] == ["4", "high_five_avatar", "215"]
