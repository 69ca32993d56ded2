"""Markers to arm: when the arm holds does not depend on what the tracker believes."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.contact_goal import palm_goal
from highfive.hil.arm.lifecycle import ready_arm
from highfive.hil.arm.loop import ArmLoop
from highfive.hil.arm.planner import Retarget
from highfive.hil.arm.preconditions import check_person
from highfive.hil.arm.rig_planner import full_errors, retarget_settings
from highfive.hil.arm.simulated_driver import SimulatedDriver, mounted_arm
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.hil.commands.simulate import SimulateOptions, simulate
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.latch import Latch
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.safety.startup import Check
from highfive.hil.safety.states import State
from highfive.hil.session.session import RATE_HZ, Session
from highfive.hil.sim.scene import build_scene
from highfive.hil.trials.partners import Partner, simulated_partners
from highfive.mocap_bridge.files.recording import make_recording
from highfive.mocap_bridge.markers.marker_set_file import load_marker_set
from highfive.mocap_bridge.sources.source import C3DSource
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.store import load_model

READY = default_arm().ready


@pytest.mark.parametrize("part", ["hand", "head"])
@pytest.mark.slow
def test_the_arm_holds_in_time_after_the_last_marker_was_measured(part: str) -> None:
    """Every marker of hand or head is hidden at once, while the hand comes up; the tracker carries it on for longer."""
    partner = simulated_partners(1, ["neutral"], ["B2"], 0, lambda _: lambda *_: None)[0]
    marker_set, limits, rig = partner.marker_set, load_limits(), load_rig()
    twin = SimulatedDriver(mounted_arm(), full_errors(rig))
    retarget = Retarget(default_arm(), READY, retarget_settings(rig, limits, on_the_way=0.0))
    loop = ArmLoop(twin, retarget, limits, lambda: Check(twin.now(), ()), Latch(twin), twin)
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
        twin.wait_until(twin.now() + round(1e9 / RATE_HZ))
    assert states[State.HOLDING] <= 0.100
    assert states[State.RETRACTING] <= 0.500
    assert part == "head" or believed > 0.15  # the tracker still knew where the hand was


ADDRESS = "vicon://host"
REAL = ArmOptions("/dev/ttyUSB99", armed=True, person=ADDRESS, calibration=Path("room.toml"))
NO_HEAD = (
    r"marker set upper_limb has no marker on the head: STER, XIPH, T1, T10 .* thoracic_8.* use a set with head markers"
)


def test_a_real_arm_does_not_move_near_a_person_whose_head_no_marker_shows() -> None:
    """The face zone would follow the trunk, and never be stale."""
    trunk, paper = load_marker_set("upper_limb"), load_marker_set("paper")
    with pytest.raises(HighFiveError, match=NO_HEAD) as error:
        check_person(REAL, trunk)
    assert "\n" not in str(error.value)
    with pytest.raises(HighFiveError, match="no marker set"):
        check_person(REAL, None)
    with pytest.raises(HighFiveError, match=NO_HEAD), ready_arm(REAL, marker_set=trunk):  # before a port is opened
        pass
    check_person(REAL, paper)
    check_person(replace(REAL, port="emulated"), trunk)
    check_person(replace(REAL, person="", nobody_near=True), trunk)


def test_a_session_tells_its_arm_what_the_live_person_wears(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The motion capture and the servos are taken for well; nothing is asked of either."""
    worn = load_marker_set("upper_limb")

    class Person:
        """Who wears that set."""

        def partner(self, emotion: str) -> Partner:
            count = len(worn)
            none = make_recording(RATE_HZ, worn.names, np.zeros((0, count, 3)), np.zeros((0, count), dtype=bool))
            return Partner(ADDRESS, emotion, "", False, none, worn, -1, None, None, ())

    replaced: dict[str, Callable[..., object]] = {
        "hil.arm.preconditions.check_arm": lambda _: None,
        "hil.commands.session_check.check_before_session": lambda *_: None,
        "hil.commands.live_session.live_source": lambda *_: nullcontext(),
        "hil.commands.live_session.LivePerson": lambda *_, **__: Person(),
        "hil.commands.live_session.closing": lambda source: source,
        "hil.commands.live_session.load_arm": lambda _: SimpleNamespace(
            registration=SimpleNamespace(placement=None), latency={}, marker_names=()
        ),
    }
    for name, replacement in replaced.items():
        monkeypatch.setattr(f"highfive.{name}", replacement)
    options = SimulateOptions(trials=1, source=ADDRESS, arm=replace(REAL, person=""))
    with pytest.raises(HighFiveError, match=NO_HEAD):
        simulate(options, tmp_path / "out", lambda *_: lambda *_, **__: None)
