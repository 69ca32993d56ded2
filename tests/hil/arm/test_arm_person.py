"""Markers to arm: when the arm holds does not depend on what the tracker believes."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.arm.contact_goal import palm_goal
from highfive.hil.arm.lifecycle import full_errors, retarget_settings
from highfive.hil.arm.loop import ArmLoop
from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.simulated_driver import TwinArm, mounted_arm
from highfive.hil.arm_model.servo_arm import READY, default_arm
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.latch import Latch
from highfive.hil.safety.limits import load_limits
from highfive.hil.safety.startup import Check
from highfive.hil.safety.states import State
from highfive.hil.session.session import RATE_HZ, Session
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import simulated_partners
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model import DEFAULT_MODEL
from highfive.model.hgpdm.store import load_model


@pytest.mark.parametrize("part", ["hand", "head"])
def test_the_arm_holds_in_time_after_the_last_marker_was_measured(part: str) -> None:
    """Every marker of hand or head is hidden at once, while the hand comes up; the tracker carries it on for longer."""
    partner = simulated_partners(1, ["neutral"], ["B2"], 0, lambda _: lambda *_: None)[0]
    marker_set, limits, rig = partner.marker_set, load_limits(), load_rig()
    twin = TwinArm(mounted_arm(), full_errors(rig))
    retarget = Retarget(default_arm(), READY, retarget_settings(rig, limits, on_the_way=0.0))
    loop = ArmLoop(twin, retarget, limits, lambda: Check(twin.clock(), ()), Latch(), twin.clock, twin.pause)
    arm = marker_set.arm
    hidden = {"hand": {*arm.wrist, *arm.hand, *arm.across}, "head": set(arm.head)}[part]
    session = Session(load_model(DEFAULT_MODEL), {"neutral": 1.0}, marker_set, build_scene())
    frames = list(C3DSource(partner.recording, RATE_HZ))
    last = next(i for i in range(partner.contact_frame - 40, len(frames)) if frames[i].valid.all())
    loop.begin()
    states: dict[State, float] = {}
    believed = 0.0
    for number, whole in enumerate(frames[: last + 80]):
        seen = whole.valid & np.array([number <= last or name not in hidden for name in whole.names])
        frame = replace(whole, valid=seen)
        loop.note_frame()
        tick = session.step(frame)
        report = loop.tick(palm_goal(tick)).report
        if number <= last:
            assert number < 10 or report.state is State.TRACKING
        else:
            ago = (number - last) / RATE_HZ
            states.setdefault(report.state, ago)
            believed = ago if tick.person.valid and part == "hand" else believed
        twin.pause(1.0 / RATE_HZ)
    assert states[State.HOLDING] <= 0.100
    assert states[State.RETRACTING] <= 0.500
    assert part == "head" or believed > 0.15  # the tracker still knew where the hand was
