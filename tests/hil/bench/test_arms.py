"""Arms that are not as their model says: what is off, and that a perturbation of nothing is none."""

from dataclasses import replace

import numpy as np
import pytest

from highfive.hil.arm.arm_options import ArmOptions
from highfive.hil.arm.arm_trial import played_until_stopped
from highfive.hil.arm.contact_outcome import ReferenceTrajectory
from highfive.hil.arm.lifecycle import emulator_options, virtual_arm
from highfive.hil.bench.arms import ArmJob, ArmPlayed, ArmsOptions, arms_figures, bench_arms, play_with
from highfive.hil.bench.black_box import BlackBox
from highfive.hil.bench.fault_laws import Laws, judge_body, judge_commands
from highfive.hil.bench.perturbed_arm import DELAY_S, MASS, PLAY, VOLTS, ZERO, drawn_perturbation, perturbed_bus
from highfive.hil.bench.virtual_play import default_planner
from highfive.hil.drivers.bus.rig import load_rig
from highfive.hil.drivers.emulator.emulated_bus import EmulatedBus
from highfive.hil.drivers.emulator.emulator_process import make_bus
from highfive.hil.drivers.emulator.virtual_rig import VirtualRig
from highfive.hil.runtime.virtual_clock import VirtualClock
from highfive.hil.safety.limits_file import load_limits
from highfive.hil.sim.people.emotions import EMOTIONS
from highfive.model import DEFAULT_MODEL
from highfive.model.errors import HighFiveError
from highfive.model.hgpdm.store import load_model


def quiet(_: str, __: int):
    return lambda *_, **__: None


def none_of(seed: int):
    """The perturbation of a seed, with nothing left of it."""
    one = np.ones(6)
    drawn = drawn_perturbation(seed)
    return replace(
        drawn, masses=one, friction=one, torques=one, play=0.0 * one, delay_s=0.0, voltage=12.0, zeros=0.0 * one
    )


def test_every_arm_is_another_and_within_bounds() -> None:
    drawn = [drawn_perturbation(seed) for seed in range(100)]
    masses = np.array([it.masses for it in drawn])
    assert 1.0 - MASS <= masses.min() < 0.85 and 1.15 < masses.max() <= 1.0 + MASS
    assert len(np.unique(masses)) == masses.size
    assert all(np.count_nonzero(it.zeros) == 1 and np.abs(it.zeros).max() == ZERO for it in drawn)
    assert all((it.play >= 0.0).all() and (it.play <= PLAY).all() for it in drawn)
    assert all(0.0 <= it.delay_s <= DELAY_S and VOLTS[0] <= it.voltage <= VOLTS[1] for it in drawn)


def goals_and_body(bus: EmulatedBus, reference: ReferenceTrajectory) -> list[np.ndarray]:
    rows: list[np.ndarray] = []
    with VirtualClock() as clock:
        virtual = VirtualRig(clock, bus, lambda _: rows.append(np.concatenate(bus.body)))
        with virtual_arm(virtual, retarget=default_planner()) as loop:
            played_until_stopped(reference, loop)
    return rows


@pytest.mark.slow
def test_a_perturbation_of_nothing_is_the_arm_itself_to_the_bit(reference: ReferenceTrajectory) -> None:
    plain = goals_and_body(make_bus(emulator_options(ArmOptions())), reference)
    same = goals_and_body(perturbed_bus(none_of(0), load_rig()), reference)
    np.testing.assert_array_equal(np.array(same), np.array(plain))


@pytest.mark.parametrize("what", ["masses", "friction", "torques", "play", "delay_s", "voltage", "zeros"])
def test_whatever_is_off_moves_the_body_otherwise(what: str) -> None:
    """Goals that jump, and the body 40 ms later."""
    goals = {servo.id: servo.values["goal_position"] + 60 for servo in perturbed_bus(none_of(3), load_rig()).servos}

    def after(perturbation) -> np.ndarray:
        bus, now = perturbed_bus(perturbation, load_rig()), 50_000_000
        for servo in bus.servos:
            assert not servo.write(servo.table["torque_enable"].address, bytes((1,)), 0)
        bus.advance(now)
        for servo in bus.servos:
            data = goals[servo.id].to_bytes(4, "little", signed=True)
            assert not servo.write(servo.table["goal_position"].address, data, now)
        bus.advance(now + 40_000_000)
        return bus.body[0]

    drawn, none = drawn_perturbation(3), none_of(3)
    moved = after(replace(none, **{what: getattr(drawn, what)})) - after(none)
    assert 1e-5 < np.abs(moved).max() < 0.1


@pytest.mark.slow
def test_a_perturbed_arm_meets_the_hand_and_keeps_the_laws(reference: ReferenceTrajectory) -> None:
    played = play_with(ArmJob(11, (reference,)))
    assert played == play_with(ArmJob(11, (reference,)))
    assert not played.trouble and not played.laws.broken
    (outcome,) = played.outcomes
    assert outcome.touched and 0.5e-3 < outcome.error < 0.03


@pytest.mark.slow
def test_a_law_can_fail_and_is_then_named_with_its_arm(reference: ReferenceTrajectory) -> None:
    """What an arm did, judged by an envelope that allows a quarter of the speed."""
    limits, rig, planner, laws = load_limits(), load_rig(), default_planner(), Laws()
    slower = replace(
        limits,
        joints=tuple(replace(joint, speed=0.25 * joint.speed) for joint in limits.joints),
        feed_forward=replace(limits.feed_forward, speed=0.25 * limits.feed_forward.speed),
    )
    with VirtualClock(11) as clock:
        bus = perturbed_bus(drawn_perturbation(11), rig)
        box = BlackBox(bus, rig)
        with virtual_arm(VirtualRig(clock, bus, box.look), retarget=planner) as loop:
            trial = played_until_stopped(reference, loop)
    assert trial is not None
    judge_commands(laws, trial, slower, planner.arm)
    judge_body(laws, box, slower)
    assert {"wire: speed, of what is allowed", "body: speed, of what is allowed"} <= {law for law, _ in laws.broken}

    kept = play_with(ArmJob(12, (reference,)))
    broken = ArmPlayed((trial.met,), laws, (0.1, 0.1), {"body: a figure": 2.0}, "")
    found = arms_figures([ArmJob(11, (reference,)), ArmJob(12, (reference,))], [broken, kept])
    assert found["arms"] == found["high_fives"] == 2
    assert [(one["law"], one["value"]) for one in found["broken"]] == laws.broken
    assert {one["arm"] for one in found["broken"]} == {11}
    assert found["motion"]["body: a figure"] == 2.0 and "body: acceleration, of what is allowed" in found["motion"]
    assert all(found["worst"][law] >= round(value, 4) for law, value in laws.broken)


@pytest.mark.sweep
@pytest.mark.slow(60)
def test_arms_at_three_cells_keep_the_laws_and_all_are_counted() -> None:
    """`make sweep` plays an arm at each of the nine."""
    found = bench_arms(ArmsOptions(3), load_model(DEFAULT_MODEL), quiet)
    assert not found["broken"] and not found["stopped"]
    assert found["arms"] == 3 and 0 < found["high_fives"] <= 3 * len(EMOTIONS)
    assert 0 <= found["missed"] < found["high_fives"]
    error, by_arm = found["error_mm"], found["by_arm_mm"]
    assert 0.0 < error["median"] <= error["p90"] <= error["max"] < 1e3
    assert 0.0 < by_arm["median"] <= by_arm["max"] <= error["max"]
    assert found["worst"] and np.isfinite(list(found["worst"].values())).all()
    assert found["body_face_speed"] > 0.0  # two of the cells are beside the head
    assert found["worst"]["reference: speed near the head, m/s"] <= 0.22
    assert 0.2 < found["body_closing_speed"] < 1.45  # docs/performance.md: of fifty arms, among which these are


def test_none_is_refused() -> None:
    with pytest.raises(HighFiveError, match="ask for at least one"):
        bench_arms(ArmsOptions(0), load_model(DEFAULT_MODEL), quiet)
