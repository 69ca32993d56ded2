"""From the envelope's report to the bytes on the line: nothing comes between."""

import os
import struct
import tty

import numpy as np

from highfive.hil.arm.planner_values import PalmGoal
from highfive.hil.bench.contact import twin_loop
from highfive.hil.drivers.bus.joint_bus import JointBus
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.bus.servo_bus import ServoBus
from highfive.hil.safety.states import State
from highfive.mocap_bridge.frames import PalmPose

SYNC_WRITE, BROADCAST = 0x83, 0xFE
AMPERE, TURN = 0.00269, 4096 / (2 * np.pi)
HEAD = np.array([1.1, 0.0, 1.65])


def sent(master: int) -> dict[int, tuple[int, int]]:
    """Goal current and position by ID of the one packet on the line, read by hand (Protocol 2.0)."""
    packet = os.read(master, 4096)
    assert packet[:5] == bytes([0xFF, 0xFF, 0xFD, 0x00, BROADCAST])
    (length,) = struct.unpack_from("<H", packet, 5)
    assert len(packet) == 7 + length
    assert packet[7] == SYNC_WRITE
    _, size = struct.unpack_from("<HH", packet, 8)
    assert size == 6
    entries = packet[12:-2]
    assert len(entries) % 7 == 0
    return {entries[at]: struct.unpack_from("<hi", entries, at + 1) for at in range(0, len(entries), 7)}


def test_the_bytes_on_the_line_are_the_report_s() -> None:
    """Every tick of an arm that sets off towards a hand: what the report says was sent is what the servos are told."""
    rig, loop = load_rig(), twin_loop()
    master, slave = os.openpty()
    tty.setraw(slave)
    bus = ServoBus(os.ttyname(slave), rig.baud_rate, rig.models)
    try:
        joints = JointBus(bus, rig)
        plate = loop.retarget.arm.plate_at(loop.retarget.ready)
        palm = PalmPose(plate.position + 0.1, plate.normal, plate.fingers, np.zeros(3))
        person = PalmPose(plate.position + np.array([0.5, 0.0, 0.1]), -plate.normal, plate.fingers, np.zeros(3))
        for tick in loop.play([PalmGoal(palm, person, HEAD)] * 60)[0]:
            if (command := tick.report.sent) is None:
                continue
            joints.write(command)
            told = sent(master)
            assert set(told) == {joint.id for joint in rig.joints}
            for joint, position, current in zip(rig.joints, command.positions, command.currents, strict=True):
                assert told[joint.id] == (round(current / AMPERE), joint.zero + round(position * TURN)), joint.name
        assert loop.state is State.READY
    finally:
        bus.close()
        os.close(master)
        os.close(slave)
