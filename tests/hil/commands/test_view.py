"""``highfive view`` tells what a recording lacks: its end, or its arm; and which hand was given."""

import json
from pathlib import Path

import numpy as np
import pytest
from live_commands import ended, start
from mcap.reader import make_reader
from mcap.records import Schema
from mcap.writer import Writer
from websockets.sync.client import connect

from highfive.hil.arm_model.arm_folder import find_arm
from highfive.hil.arm_model.servo_arm import mounted
from highfive.hil.commands.view import ViewOptions, view
from highfive.hil.recording.session_reader import read_session
from highfive.hil.sim.scene import build_scene
from highfive.hil.view import SHIPPED_RECORDING
from highfive.hil.view.live_page import LivePage
from highfive.hil.view.player import Player
from highfive.hil.view.recorded import recorded_trials
from highfive.model.errors import HighFiveError


def viewed(path: Path) -> tuple[dict[str, object], str, int, str]:
    """What a page is told first, what was said until its address was, and the code and the words of the end."""
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
    return hello, said, code, err


@pytest.mark.parametrize("share", [0.5, 1.0])
@pytest.mark.slow
def test_a_recording_that_was_cut_short_says_so_on_terminal_and_page(share: float, tmp_path: Path) -> None:
    path, whole = tmp_path / "session.mcap", SHIPPED_RECORDING.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    hello, said, code, err = viewed(path)
    assert code == 0 and hello["kind"] == "hello" and hello["cut"] == (share < 1.0)
    assert ("was cut short" in said) == (share < 1.0) and "was cut short" not in err


@pytest.mark.slow
def test_a_folder_is_called_by_its_own_name_and_what_is_in_it_is_told(tmp_path: Path) -> None:
    folder = tmp_path / "participant 3"
    folder.mkdir()
    with pytest.raises(HighFiveError, match=r"participant 3 is a folder without a recording"):
        view(ViewOptions(folder))
    (folder / "block-1.mcap").write_bytes(SHIPPED_RECORDING.read_bytes())
    hello, said, code, _ = viewed(folder)
    assert code == 0 and hello["title"] == "participant 3"
    assert said.startswith("participant 3: read") and "session.mcap" not in said
    (folder / "block-2.mcap").write_bytes(b"")
    with pytest.raises(HighFiveError, match=r"2 recordings; give one of them: block-1.mcap, block-2.mcap"):
        view(ViewOptions(folder))


def altered(path: Path, settings: dict[str, object], arm: bool) -> Path:
    """The shipped recording with other settings, and with messages of a servo arm in each high five."""
    with SHIPPED_RECORDING.open("rb") as source, path.open("wb") as target:
        writer, numbers = Writer(target), dict[str, int]()
        writer.start()

        def add(topic: str, schema: Schema | None, encoding: str, data: bytes, time: int) -> None:
            if topic not in numbers:
                kind = 0 if schema is None else writer.register_schema(schema.name, schema.encoding, schema.data)
                numbers[topic] = writer.register_channel(topic, encoding, kind)
            writer.add_message(numbers[topic], time, data, time)

        for schema, channel, message in make_reader(source).iter_messages():
            data = message.data
            if channel.topic == "/session":
                about = json.loads(data)
                about["settings"] |= settings
                data = json.dumps(about).encode()
            add(channel.topic, schema, channel.message_encoding, data, message.log_time)
            if arm and channel.topic == "/tick":
                for topic, name in (("/safety", "wanted"), ("/arm", "positions")):
                    add(topic, None, "json", json.dumps({name: [0.0] * 6}).encode(), message.log_time)
        writer.finish()
    return path


def hello_of(page: LivePage) -> dict[str, object]:
    with connect(page.address.replace("http", "ws", 1).replace("/?", "/live?"), compression=None) as link:
        return json.loads(link.recv(20.0))


@pytest.mark.slow
def test_a_recording_whose_arm_is_elsewhere_is_shown_without_it(tmp_path: Path) -> None:
    folder = "/home/somebody/arms/mine"
    hello, said, code, _ = viewed(altered(tmp_path / "a.mcap", {"arm_name": folder}, arm=True))
    assert code == 0 and hello["rig"] is False and folder not in json.dumps(hello)
    assert f"shown without its servo arm: there is no arm '{folder}'" in said


@pytest.mark.slow
def test_pages_are_not_told_whose_folder_an_arm_is_in(tmp_path: Path) -> None:
    with LivePage({"mode": "session", "rig": str(tmp_path)}, port=0) as page:
        assert hello_of(page)["rig"] is True


@pytest.mark.slow
@pytest.mark.parametrize(
    "source, hand",
    [
        ("headset://page?hand=left", "left"), ("headset://page", "right"), ("webcam?hand=left", "left"),
        ("greeting.c3d", "right"), ("", "right"), ("strange://of-a-plug-in?hand=left", "right"),
    ],
)  # fmt: skip
def test_a_recording_tells_which_hand_she_gave(source: str, hand: str, tmp_path: Path) -> None:
    trials = recorded_trials(altered(tmp_path / "a.mcap", {"source": source}, arm=False), build_scene())
    assert trials.hand == hand and not trials.rig and not trials.without_arm


def test_of_a_recording_with_an_arm_it_is_told_how_far_the_plate_is_from_the_palm(tmp_path: Path) -> None:
    """By the kinematics that the arm is driven with, from where the person's palm was recorded."""
    path = altered(tmp_path / "a.mcap", {}, arm=True)
    trials, plate = recorded_trials(path, build_scene()), mounted(find_arm()).plate_at(np.zeros(6)).position
    palms = np.array([message.data["palm"] for message in read_session(path)[0].of("/person")])
    found = trials[0].plates
    assert found is not None and len(found) == len(palms)
    np.testing.assert_allclose(found, np.linalg.norm(palms - plate, axis=1), atol=1e-5)
    player = Player(trials)
    assert player.state()["plate_m"] == found[0] != player.state()["palms_m"]
    assert "plate_m" not in Player(recorded_trials(SHIPPED_RECORDING, build_scene())).state()
