"""Puts what was played in a trial into a scene, to be drawn: the avatar or the servo arm, and the person."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from highfive.hil.sim.avatar import avatar_skeleton
from highfive.hil.sim.person import PersonBodies
from highfive.hil.sim.scene import Scene
from highfive.hil.trials.trial_result import TrialResult

if TYPE_CHECKING:
    from highfive.hil.arm.arm_trial import ArmTrial
    from highfive.hil.sim.arm_body import ArmTwin


class Stage:
    """The state of a scene at any tick of a trial; see :func:`avatar_stage` and :func:`arm_stage`."""

    def __init__(
        self,
        scene: Scene | ArmTwin,
        fresh: Callable[[], mujoco.MjData],
        pose: Callable[[mujoco.MjData, TrialResult, int], None],
    ) -> None:
        """Of a ``scene``; ``fresh`` makes a state of it, ``pose`` puts who meets the person into one, at a tick."""
        self.scene, self._fresh, self._pose = scene, fresh, pose
        self._person = PersonBodies(scene.model, avatar_skeleton())
        self.data = fresh()
        self._result: TrialResult | None = None
        self._tick = 0

    def show(self, result: TrialResult, tick: int) -> mujoco.MjData:
        """The state at a tick, ready to be drawn."""
        # The person's feet follow the trunk on a leash, so where they are depends on all ticks before.
        if result is not self._result or tick < self._tick:
            self.data = self._fresh()
            self._result, self._tick = result, -1
        for i in range(self._tick + 1, tick + 1):
            self._person.put(self.data, result.people[i])
        self._tick = tick
        self._pose(self.data, result, tick)
        mujoco.mj_kinematics(self.scene.model, self.data)
        return self.data


def avatar_stage(scene: Scene) -> Stage:
    """Avatar and person, as played; ``scene`` is built ``visible``."""
    return Stage(scene, scene.make_data, lambda data, result, tick: scene.set_pose(data, result.poses[tick]))


def arm_stage(twin: ArmTwin, arms: Mapping[int, ArmTrial]) -> Stage:
    """The arm instead of the avatar, where its servos said that they were; ``arms`` by the trials' numbers."""

    def fresh() -> mujoco.MjData:
        data = mujoco.MjData(twin.model)
        mujoco.mj_forward(twin.model, data)
        return data

    def pose(data: mujoco.MjData, result: TrialResult, tick: int) -> None:
        arm = arms[result.number]
        time = arm.times[min(tick, len(arm.times) - 1)]  # stopped before the end, it stays where it was
        data.qpos[twin.qpos] = [np.interp(time, arm.cycle_times, joint) for joint in arm.actual.T]

    return Stage(twin, fresh, pose)
