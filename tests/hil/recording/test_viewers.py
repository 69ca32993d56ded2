"""What viewers make of a recording: readers that are not ours."""

import json
import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from mcap_ros2.decoder import DecoderFactory as RosDecoderFactory
from recorded_trials import record_trial
from trial_results import some_results

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.lifecycle import emulator_options, virtual_arm
from highfive.hil.arm.loop import ArmTick
from highfive.hil.arm.planner_values import PalmGoal
from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm, shipped
from highfive.hil.arm_model.servo_arm import default_arm, mounted
from highfive.hil.drivers.bus.cycle_ring import Cycle
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.recording import plots, schemas
from highfive.hil.recording.recorder import SessionRecorder
from highfive.hil.recording.recording import read_recording
from highfive.hil.recording.viewer_messages import Transforms, joints_of
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.trials.summary import SessionSettings
from highfive.hil.view.arm_cast import GHOST, ArmCast
from highfive.mocap_bridge.frames import PalmPose
from highfive.model.geometry import rotations

FOXGLOVE = "@foxglove/studio-base@1.48.0"
"""The last open release of Foxglove's own viewer (MPL-2.0)."""
_PLATE_NORMAL, _PLATE_FINGERS = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
"""In the plate's own frame, as the scene draws it."""
_PARSE = """
const fs = require("fs"), dir = process.argv[1] + "/package/assets/";
const found = fs.readdirSync(dir).map(name => fs.readFileSync(dir + name, "utf8"))
    .find(text => text.includes("function parseJsonSchema("));
const source = found.slice(found.indexOf("function parseJsonSchema("));
const parse = new Function("base64", source.slice(0, source.indexOf("\\n}\\n") + 3) + "return parseJsonSchema;")({});
const answers = {};
for (const [name, schema] of Object.entries(JSON.parse(fs.readFileSync(0)))) {
    try { answers[name] = [...parse(schema, name).datatypes.keys()]; } catch (error) { answers[name] = String(error); }
}
console.log(JSON.stringify(answers));
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("viewers") / "session.mcap"
    with SessionRecorder(path, SessionSettings(seed=3, model="default", trials=1)) as recorder:
        record_trial(recorder, some_results()[0])
        recorder.record_event("contact", trial=0, emotion="sad")
        recorder.record_log("WARNING", "the disk is slow")
    return path


def decoded(path: Path) -> dict[str, list[Any]]:
    """Messages by topic, as the ``mcap`` package and protobuf decode them."""
    found: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        for schema, channel, message, content in make_reader(
            file, decoder_factories=[DecoderFactory()], validate_crcs=True
        ).iter_decoded_messages(topics=["/tf", "/markers", "/skeleton", "/log"]):
            assert schema is not None and schema.name.startswith("foxglove.")
            stamps = {"/tf": "transforms", "/skeleton": "entities"}.get(channel.topic)
            for one in [content] if stamps is None else getattr(content, stamps):
                assert one.timestamp.ToNanoseconds() == message.log_time
            found.setdefault(channel.topic, []).append(content)
    return found


def test_the_transforms_place_every_body_where_it_was(recorded: Path) -> None:
    result, messages = some_results()[0], decoded(recorded)["/tf"]
    assert len(messages) == -(-len(result.times) // 4)
    for number in (0, 31, 60):
        places = {"world": (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))}
        for one in messages[number].transforms:
            at, turn = places[one.parent_frame_id]
            by = one.rotation
            move = np.array([one.translation.x, one.translation.y, one.translation.z])
            places[one.child_frame_id] = (
                at + rotations.rotate(turn, move),
                rotations.multiply(turn, np.array([by.w, by.x, by.y, by.z])),
            )
        names = avatar_skeleton().names
        drawn = np.array([places[f"avatar/{name}"][0] for name in names])
        np.testing.assert_allclose(drawn, joints_of([result.poses[4 * number]])[0], atol=1e-6)
        person = result.people[4 * number]
        np.testing.assert_allclose(places["person/wrist"][0], person.wrist, atol=1e-6)
        palm, turn = places["person/palm"]
        np.testing.assert_allclose(palm, person.palm.position, atol=1e-6)
        normal = rotations.rotate(turn, np.array([0.0, 0.0, 1.0]))
        np.testing.assert_allclose(normal, person.palm.normal, atol=1e-5)


def test_the_arm_is_drawn_where_its_joints_are() -> None:
    """Against the arm's own kinematics, from its description, where the drawing's are MuJoCo's."""
    arm, drawn, rng = default_arm(), Transforms(), np.random.default_rng(5)
    for joints in [np.zeros(6), *rng.uniform(-1.2, 1.2, (20, 6))]:
        bodies = {one.child_frame_id: one for one in drawn.arm(7, joints).transforms}
        assert all(one.parent_frame_id == "world" and one.timestamp.ToNanoseconds() == 7 for one in bodies.values())
        places = {name: [getattr(one.translation, axis) for axis in "xyz"] for name, one in bodies.items()}
        for name, where in zip(("plate", "wrist", "upper_forearm", "tool"), arm.points(joints)[0], strict=True):
            np.testing.assert_allclose(places[f"arm/{name}"], where, atol=1e-6)
        plate, by = arm.plate_at(joints), bodies["arm/plate"].rotation
        turn = np.array([by.w, by.x, by.y, by.z])
        for axis, wanted in ((_PLATE_NORMAL, plate.normal), (_PLATE_FINGERS, plate.fingers)):
            np.testing.assert_allclose(rotations.rotate(turn, np.array(axis)), wanted, atol=1e-5)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[] if name == "vx300s" else pytest.mark.slow) for name in shipped()]
)
def test_each_arm_is_drawn_and_shown_where_its_own_kinematics_have_its_plate(name: str) -> None:
    arm = mounted(find_arm(name))
    drawn, cast, rng = Transforms(name), ArmCast(name), np.random.default_rng(6)
    low, high = arm.packed.low, arm.packed.high
    assert cast.joints == arm.joints
    for joints in [arm.ready, *rng.uniform(low, high, (5, arm.joints))]:
        bodies = {one.child_frame_id: one for one in drawn.arm(7, joints).transforms}
        at = bodies["arm/plate"].translation
        shown = dict(zip(cast.names, cast.poses(joints, arm.ready), strict=True))
        for pose, place in ((joints, shown["arm_plate"]), (arm.ready, shown[GHOST + "arm_plate"])):
            np.testing.assert_allclose(place[:3], arm.plate_at(pose).position, atol=2e-3)
        np.testing.assert_allclose([at.x, at.y, at.z], shown["arm_plate"][:3], atol=1e-6)
        away = np.linalg.norm(arm.plate_at(joints).position - np.array(arm.mount.position))
        assert away < arm.reach


def test_markers_are_points_and_words_are_a_log(recorded: Path) -> None:
    result, found = some_results()[0], decoded(recorded)
    cloud = found["/markers"][5]
    fields = {field.name: field.offset for field in cloud.fields}
    raw = np.frombuffer(cloud.data, dtype=np.uint8).reshape(-1, cloud.point_stride)
    for axis, name in enumerate("xyz"):
        values = raw[:, fields[name] : fields[name] + 4].copy().view(np.float32)[:, 0]
        np.testing.assert_allclose(values, result.markers[5].positions[:, axis], atol=1e-6)
    assert raw[:, fields["seen"]].astype(bool).tolist() == result.markers[5].seen.tolist()
    event, line = found["/log"]
    assert (event.level, event.message) == (2, "contact (trial 0, emotion sad)")
    assert (line.level, line.message) == (3, "the disk is slow")


def with_arm(path: Path) -> Path:
    """A high five, and a second in which the emulated arm plays one."""
    virtual = VirtualRig(VirtualClock(), make_bus(emulator_options(ArmOptions())))
    with (
        SessionRecorder(path, SessionSettings(seed=3, model="default", trials=1)) as recorder,
        virtual.clock,
        virtual_arm(virtual) as loop,
    ):
        record_trial(recorder, some_results()[0])
        plate = loop.retarget.arm.plate_at(loop.retarget.ready)
        goal = PalmGoal(PalmPose(plate.position, plate.normal, plate.fingers, np.zeros(3)))
        begun = list[int]()

        def record(tick: ArmTick, cycles: Sequence[Cycle]) -> None:
            if not begun:
                recorder.begin_played(tick.frame_ns)
            begun.append(tick.frame_ns)
            recorder.record_arm([tick], cycles)

        loop.play([goal] * 120, watch=record)
    return path


def plotted(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Time and message by topic of what is ROS 2 there, as ``mcap-ros2-support`` decodes it."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with path.open("rb") as file:
        for schema, channel, message, content in make_reader(
            file, decoder_factories=[RosDecoderFactory()]
        ).iter_decoded_messages(topics=list(plots.TOPICS)):
            assert schema is not None and schema.name == "sensor_msgs/msg/JointState"
            stamp = content.header.stamp
            assert 10**9 * stamp.sec + stamp.nanosec == message.log_time
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


@pytest.mark.slow
def test_numbers_are_joint_states_of_ros_that_say_what_the_json_topics_say(tmp_path: Path) -> None:
    path = with_arm(tmp_path / "session.mcap")
    found, recording = plotted(path), read_recording(path)
    there = {topic for topic in plots.PLOTTED if recording.channels[topic]}
    assert there >= {"/tick", "/person", "/contact", "/arm", "/safety"}
    assert set(found) == {plots.JOINT_STATES} | {f"{plots.PLOT}{topic}" for topic in there}
    for topic in there:
        rows = {message.time_ns: message.data for message in recording.channels[topic]}
        for time_ns, content in found[f"{plots.PLOT}{topic}"]:
            said = plots.numbers(topic, rows[time_ns], find_arm(DEFAULT_ARM).names)
            assert content.name == list(said)
            np.testing.assert_array_equal(content.position, list(said.values()))
        times = [time_ns for time_ns, _ in found[f"{plots.PLOT}{topic}"]]
        assert len(times) >= len(rows) / 5 and (np.diff(times) >= plots.PERIOD_NS).all()
    for (time_ns, content), cycle in zip(found[plots.JOINT_STATES], recording.channels["/arm"], strict=True):
        assert time_ns == cycle.time_ns and tuple(content.name) == find_arm(DEFAULT_ARM).names
        assert (content.position, content.velocity) == (cycle.data["positions"], cycle.data["velocities"])


def test_what_is_unknown_keeps_its_place_in_a_plot() -> None:
    names = find_arm(DEFAULT_ARM).names
    known = {"trial": 0, "weight": 0.5, "time_to_contact": 0.2, "latency_ms": 1.0, "framed": True, "sure": True}
    whole, without = (plots.numbers("/tick", row, names) for row in (known, {**known, "time_to_contact": None}))
    assert list(whole) == list(without) and np.isnan(without["time_to_contact"]) and whole["time_to_contact"] == 0.2
    arm = {"took_ns": 1, "sent": None, "positions": [0.1] * len(names)}
    sent = plots.numbers("/arm", arm, names)
    assert np.isnan(sent["sent.elbow"]) and sent["positions.elbow"] == 0.1


def test_every_json_message_keeps_to_its_schema(recorded: Path) -> None:
    kinds = {"number": (int, float), "integer": int, "string": str, "boolean": bool, "object": dict}
    with recorded.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            if channel.message_encoding != "json":
                continue
            said, data = json.loads(schema.data), json.loads(message.data)
            assert set(said["required"]) <= data.keys() <= said["properties"].keys(), channel.topic
            for name, value in data.items():
                kind = said["properties"][name]
                items = value if kind["type"] == "array" else [value]
                one = kind.get("items", kind)["type"]
                assert all(isinstance(item, kinds[one]) for item in items), (channel.topic, name)


@pytest.mark.slow(40)
def test_foxglove_itself_can_plot_every_json_topic(tmp_path: Path) -> None:
    if shutil.which("npm") is None or shutil.which("node") is None:
        pytest.skip("no npm here")
    fetched = subprocess.run(["npm", "pack", FOXGLOVE], cwd=tmp_path, capture_output=True, text=True, check=False)
    if fetched.returncode:
        pytest.skip("npm cannot fetch anything here")
    subprocess.run(["tar", "xzf", fetched.stdout.split()[-1]], cwd=tmp_path, check=True)
    ours = {topic: schemas.schema_of(topic) for topic in schemas.TOPICS}
    wrong = {"rows": {"type": "object", "properties": {"a": {"type": "array", "items": {"type": "array"}}}}}
    answer = subprocess.run(
        ["node", "-e", _PARSE, tmp_path], input=json.dumps(ours | wrong), capture_output=True, text=True, check=True
    )
    said = json.loads(answer.stdout)
    assert "Unsupported type" in said.pop("rows")  # it would tell
    assert all(isinstance(types, list) and topic in types for topic, types in said.items()), said


RERUN = os.environ.get("RERUN") or shutil.which("rerun")
"""Rerun's own program (PyPI rerun-sdk, 170 MB to load, 500 MB installed: too much for CI)."""


@pytest.mark.slow(10)
@pytest.mark.skipif(RERUN is None, reason="rerun (PyPI rerun-sdk) is neither on PATH nor in RERUN")
def test_rerun_itself_draws_every_transform_marker_and_line(recorded: Path, tmp_path: Path) -> None:
    def run(*words: object) -> str:
        environment = {**os.environ, "HOME": str(tmp_path), "NO_COLOR": "1"}
        for command in (["analytics", "disable"], words):  # the setting is the home folder's, which is a new one
            done = subprocess.run(
                [str(RERUN), *map(str, command)], capture_output=True, text=True, check=True, env=environment
            )
        return done.stdout

    drawn = tmp_path / "session.rrd"
    run("mcap", "convert", recorded, "-o", drawn)
    pattern = r"with (\d+) rows .* - (/\S+) - data columns: \[(.*)\]"
    rows: dict[tuple[str, str], int] = {}
    for count, topic, columns in re.findall(pattern, run("rrd", "print", drawn)):
        for kind in {column.partition(":")[0] for column in columns.split()}:
            rows[topic, kind] = rows.get((topic, kind), 0) + int(count)
    ticks = len(some_results()[0].times)
    transforms = sum(len(message.transforms) for message in decoded(recorded)["/tf"])
    assert rows["/tf", "Transform3D"] == transforms
    assert rows["/markers", "Points3D"] == ticks and rows["/log", "TextLog"] == 2
    for topic, messages in plotted(recorded).items():
        assert rows[f"{topic}/position", "Scalars"] == len(messages), topic


def test_the_times_of_all_topics_are_of_one_clock(tmp_path: Path) -> None:
    """A session that keeps time begins at 0 of its recording, and says of each high five when that was."""
    result = some_results()[0]
    path = tmp_path / "paced.mcap"
    with SessionRecorder(
        path, SessionSettings(seed=3, model="m", trials=2), None, lambda: 1_700_000_000_000_000_000
    ) as it:
        record_trial(it, result, from_ns=5_000_000_000_000)
        record_trial(it, replace(result, number=1), from_ns=5_030_000_000_000)
    with path.open("rb") as file:
        messages = [
            (channel.topic, message.log_time, json.loads(message.data))
            for _, channel, message in make_reader(file).iter_messages(topics=["/trial", "/tick"])
        ]
    trials = [(time, data["host_ns"], data["utc"]) for topic, time, data in messages if topic == "/trial"]
    assert trials == [
        (0, 5_000_000_000_000, "2023-11-14T22:13:20.000+00:00"),
        (30_000_000_000, 5_030_000_000_000, "2023-11-14T22:13:20.000+00:00"),
    ]
    assert all(data["at_ns"] - time == 5_000_000_000_000 for topic, time, data in messages if topic == "/tick")
