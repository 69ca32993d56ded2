"""The avatar in VMC: what a program that knows Unity's conventions alone makes of it."""

import errno
import logging
import os
import socket
import struct
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from recorded_trials import ticks_of
from scipy.spatial.transform import Rotation
from trial_results import some_results

from highfive.hil.publish.vmc import BONES, LONGEST, VmcPublisher, bone_places, in_unity
from highfive.hil.recording.recorded_tick import RecordedTick
from highfive.hil.runtime.console import LOGGER
from highfive.hil.sim.avatar import Pose, avatar_skeleton
from highfive.model.errors import HighFiveError
from highfive.model.geometry import rotations

UNITY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])  # x right, y up, z forward


@pytest.fixture(scope="module")
def tick() -> RecordedTick:
    return list(ticks_of(some_results()[1]))[200]


@pytest.fixture
def receiver() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        found.bind(("127.0.0.1", 0))
        found.settimeout(60.0)
        yield found


def t_pose() -> Pose:
    """Both arms out to the side, palms down; the pelvis' height as it stands."""
    skeleton = avatar_skeleton()
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(skeleton), 1))
    turns[skeleton.index("left_shoulder")] = rotations.from_axis_angle("x", np.pi / 2)
    turns[skeleton.index("right_shoulder")] = rotations.from_axis_angle("x", -np.pi / 2)
    return Pose(skeleton.offsets[0], skeleton.to_hinges(turns))


def put_together(places: np.ndarray, turns: np.ndarray) -> dict[str, tuple[np.ndarray, Rotation]]:
    """Where each bone is in Unity's world: its parent's place and rotation, then its own."""
    world: dict[str, tuple[np.ndarray, Rotation]] = {}
    for (name, (_, parent)), place, turn in zip(BONES.items(), places, turns, strict=True):
        above, turned = world[parent] if parent else (np.zeros(3), Rotation.identity())
        world[name] = above + turned.apply(place), turned * Rotation.from_quat(turn)
    return world


def test_there_are_all_bones_of_a_vrm_hand_and_body() -> None:
    assert len(BONES) == 6 + 2 * (8 + 15) and len({joint for joint, _ in BONES.values()}) == len(BONES)
    assert set(avatar_skeleton().names) - {joint for joint, _ in BONES.values()} == {"lumbar_5"}


def test_no_bone_is_turned_in_the_t_pose() -> None:
    places, turns = in_unity(*bone_places(t_pose()))
    np.testing.assert_allclose(np.abs(turns), np.tile([0.0, 0.0, 0.0, 1.0], (len(BONES), 1)), atol=1e-9)
    world = put_together(places, turns)
    assert world["RightHand"][0][0] > 0.6 and world["LeftHand"][0][0] < -0.6  # x is to the avatar's right
    assert world["Head"][0][1] > 1.5 and world["RightToes"][0][2] > 0.1  # y is up, z is forward
    assert world["RightThumbProximal"][0][2] > world["RightHand"][0][2]  # palms down: thumbs forward


def test_bones_put_together_are_where_the_joints_are(tick: RecordedTick) -> None:
    pose = tick.played
    centres, turns = avatar_skeleton().forward_kinematics(pose.root_in_world, pose.quaternions)
    still = avatar_skeleton().forward_kinematics(t_pose().root_in_world, t_pose().quaternions)[1]
    world = put_together(*in_unity(*bone_places(pose)))
    for name, (joint, _) in BONES.items():
        index = avatar_skeleton().index(joint)
        place, turn = world[name]
        np.testing.assert_allclose(place, UNITY @ centres[index], atol=1e-9)
        since_t = rotations.to_matrix(rotations.multiply(turns[index], rotations.conjugate(still[index])))
        np.testing.assert_allclose(turn.as_matrix(), UNITY @ since_t @ UNITY.T, atol=1e-9)


def messages(datagram: bytes) -> Iterator[tuple[str, list[object]]]:
    rest = datagram[16:]
    while rest:
        size = struct.unpack(">i", rest[:4])[0]
        one, rest = rest[4 : 4 + size], rest[4 + size :]
        parts: list[object] = []
        texts = []
        for _ in range(2):
            end = one.index(0)
            texts.append(one[:end].decode())
            one = one[end + 4 - end % 4 :]
        for kind in texts[1][1:]:
            if kind == "s":
                end = one.index(0)
                parts.append(one[:end].decode())
                one = one[end + 4 - end % 4 :]
            else:
                parts.append(struct.unpack(f">{kind}", one[:4])[0])
                one = one[4:]
        yield texts[0], parts


def frame(receiver: socket.socket) -> list[tuple[str, list[object]]]:
    """All messages up to the time that ends a frame."""
    found: list[tuple[str, list[object]]] = []
    while not found or found[-1][0] != "/VMC/Ext/T":
        datagram = receiver.recv(65536)
        assert len(datagram) <= LONGEST
        found += messages(datagram)
    return found


def test_a_receiver_gets_whole_frames(tick: RecordedTick, receiver: socket.socket) -> None:
    publisher = VmcPublisher("127.0.0.1", receiver.getsockname()[1])
    publisher.tick(tick)
    publisher.tick(replace(tick, at_ns=tick.at_ns + 2_000_000_000))
    publisher.close()
    first, second = frame(receiver), frame(receiver)
    assert first[:-1] == second[:-1] and first[-1] == ("/VMC/Ext/T", [0.0]) and second[-1] == ("/VMC/Ext/T", [2.0])
    assert first[0] == ("/VMC/Ext/Root/Pos", ["root", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    assert first[-2] == ("/VMC/Ext/OK", [1])
    bones = {str(values[0]): values[1:] for address, values in first if address == "/VMC/Ext/Bone/Pos"}
    assert list(bones) == list(BONES) and len(first) == len(BONES) + 3
    np.testing.assert_allclose(list(bones.values()), np.hstack(in_unity(*bone_places(tick.played))), atol=1e-6)


def test_python_osc_reads_the_same(tick: RecordedTick, receiver: socket.socket) -> None:
    bundle = pytest.importorskip("pythonosc.osc_bundle", reason="python-osc (extra dev) is not installed").OscBundle
    publisher = VmcPublisher("127.0.0.1", receiver.getsockname()[1])
    publisher.tick(tick)
    publisher.close()
    found: list[tuple[str, list[object]]] = []
    read: list[tuple[str, list[object]]] = []
    while not found or found[-1][0] != "/VMC/Ext/T":
        datagram = receiver.recv(65536)
        found += messages(datagram)
        read += [(one.address, list(one.params)) for one in bundle(datagram)]
    assert read == found and len(read) == len(BONES) + 3


def test_nobody_need_be_there(tick: RecordedTick) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    publisher = VmcPublisher("127.0.0.1", port)
    for _ in range(20):
        publisher.tick(tick)
    publisher.close()


def test_a_host_that_there_is_not_is_said_in_one_line() -> None:
    with pytest.raises(
        HighFiveError, match=r"cannot publish to vmc://no\.such\.invalid:39539: .*; give a host"
    ) as error:
        VmcPublisher("no.such.invalid", 39539)
    assert "\n" not in str(error.value)


def test_a_network_that_is_gone_is_said_once_and_so_is_its_return(
    tick: RecordedTick, receiver: socket.socket, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    class Unplugged(socket.socket):
        gone = False

        def sendto(self, *args: Any) -> int:  # as the kernel does without a route
            if Unplugged.gone:
                raise OSError(errno.ENETUNREACH, os.strerror(errno.ENETUNREACH))
            return super().sendto(*args)

    monkeypatch.setattr(socket, "socket", Unplugged)
    publisher = VmcPublisher("127.0.0.1", receiver.getsockname()[1])
    with caplog.at_level(logging.INFO, LOGGER.name):
        for gone in (False, True, True, True, False, False):
            Unplugged.gone = gone
            publisher.tick(tick)
    publisher.close()
    said = [record.getMessage() for record in caplog.records]
    assert [("cannot" in line, "again" in line) for line in said] == [(True, True), (False, True)], said
    for _ in range(3):
        frame(receiver)
