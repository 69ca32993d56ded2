"""Foxglove's live server, heard by a client of its protocol (foxglove.sdk.v1) that knows nothing of the package.

Skipped where foxglove-sdk (the extra ``foxglove``) is not installed.
"""

import json
import socket
import struct
from importlib.util import find_spec

import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from recorded_trials import ticks_of
from trial_results import some_results
from websockets.sync.client import connect

from highfive.hil.arm_model.arm_folder import DEFAULT_ARM, find_arm
from highfive.hil.arm_model.servo_arm import mounted
from highfive.hil.publish.foxglove_server import FoxglovePublisher
from highfive.hil.publish.publisher import ArmPosture, SessionEvent
from highfive.model.errors import HighFiveError

HERE = find_spec("foxglove") is not None
installed = pytest.mark.skipif(not HERE, reason="foxglove-sdk (extra foxglove) is not installed")
ARM = mounted(find_arm(DEFAULT_ARM))
KINDS = {"/tf": FrameTransforms, "/markers": PointCloud, "/skeleton": SceneUpdate, "/log": Log}


@pytest.mark.skipif(HERE, reason="foxglove-sdk is installed")
def test_without_the_package_one_line_says_what_to_install() -> None:
    with pytest.raises(HighFiveError, match=r"pip install 'high-five\[foxglove\]'"):
        FoxglovePublisher(0)


def check_arm(at: int, content: bytes) -> None:
    bodies = {one.child_frame_id: one for one in FrameTransforms.FromString(content).transforms}
    assert at == 6 and len(bodies) > 6 and all(name.startswith("arm/") for name in bodies)
    plate, place = bodies["arm/plate"].translation, ARM.points(ARM.ready)[0][0]
    assert (plate.x, plate.y, plate.z) == pytest.approx(tuple(place), abs=1e-5)


@installed
def test_a_viewer_gets_the_messages_of_a_recording() -> None:
    import base64  # noqa: PLC0415

    ticks = list(ticks_of(some_results()[1]))[1:41]
    publisher = FoxglovePublisher(0)
    with connect(f"ws://127.0.0.1:{publisher.port}", subprotocols=["foxglove.sdk.v1"], compression=None) as link:  # type: ignore[list-item]
        assert link.subprotocol == "foxglove.sdk.v1"
        channels: dict[str, dict[str, str]] = {}
        while len(channels) < 5:
            said = json.loads(link.recv(60.0))
            if said["op"] == "serverInfo":
                assert not {"clientPublish", "parameters", "services"} & set(said["capabilities"])
            if said["op"] == "advertise":
                channels |= {one["topic"]: one for one in said["channels"]}
        assert set(channels) == {*KINDS, "/event"}
        for topic, kind in KINDS.items():
            described = channels[topic]
            assert (described["encoding"], described["schemaName"]) == ("protobuf", kind.DESCRIPTOR.full_name)
            files = FileDescriptorSet.FromString(base64.b64decode(described["schema"])).file
            assert kind.DESCRIPTOR.file.name in [file.name for file in files]
        numbers = dict(enumerate(channels))
        wanted = [{"id": number, "channelId": channels[topic]["id"]} for number, topic in numbers.items()]
        link.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        # Nobody says that the subscription is known: events are sent until the first one comes.
        first = None
        while first is None:
            publisher.event(SessionEvent("session_start", 5))
            try:
                first = link.recv(0.1)
            except TimeoutError:
                continue
        found: dict[str, list[tuple[int, bytes]]] = {topic: [] for topic in channels}

        def take(data: str | bytes) -> None:
            if isinstance(data, bytes) and data[0] == 1:
                number, at = struct.unpack_from("<IQ", data, 1)
                found[numbers[number]].append((at, data[13:]))

        take(first)
        for tick in ticks:  # one after the other is taken: nothing is left out
            publisher.tick(tick)
            while not found["/markers"] or found["/markers"][-1][0] != tick.at_ns:
                take(link.recv(60.0))
        publisher.arm(ArmPosture(6, ARM.ready))
        publisher.event(SessionEvent("contact", 7, {"trial": 3, "detail": None}))
        while not found["/log"] or found["/log"][-1][0] != 7:
            take(link.recv(60.0))
    publisher.close()
    check_arm(*found["/tf"].pop())
    for topic, every in (("/markers", 1), ("/tf", 4), ("/skeleton", 4)):
        assert [at for at, _ in found[topic]] == [tick.at_ns for tick in ticks[::every]]
    places = FrameTransforms.FromString(found["/tf"][2][1])
    root = places.transforms[0]
    assert root.child_frame_id == "avatar/pelvis" and len(places.transforms) == 53 + 6
    assert root.translation.z == pytest.approx(ticks[8].played.root_in_world[2], abs=1e-6)
    assert len(PointCloud.FromString(found["/markers"][0][1]).data) == 16 * 13
    assert json.loads(found["/event"][-1][1]) == {"event": "contact", "trial": 3}
    assert Log.FromString(found["/log"][-1][1]).message == "contact trial 3"


@installed
def test_a_port_in_use_is_said_in_one_line() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(HighFiveError, match=r"cannot serve Foxglove on port \d+.*foxglove://:8766") as error:
            FoxglovePublisher(taken.getsockname()[1])
    assert "\n" not in str(error.value)
