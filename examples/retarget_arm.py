"""A high five for the servo arm, without a serial port: joint angles that meet the hand, held against the limits.

One sees how far each joint of the ViperX 300 S went, how fast, what its limits are, and by how much the palm plate
missed the person's true palm: commanded, so a real servo's error comes on top. Takes 4 s.
"""

import numpy as np

import highfive
from highfive.hil.arm.arm_files import limits_of, rig_of
from highfive.hil.arm.contact_goal import palm_goal
from highfive.hil.arm.rig_planner import planner
from highfive.hil.arm_model.servo_arm import default_arm

arm = default_arm()
limits = limits_of(arm.folder)
retarget = planner(rig_of(arm.folder), limits, arm)
person = highfive.simulated_person("happy", "B2", seed=0)
session = highfive.open_session(person.marker_set, style="happy")
state, states = retarget.start(), []
for frame in person.frames():
    state, _ = retarget.step(state, palm_goal(session.step(frame)))  # one tick: markers, avatar, arm
    states.append(state)
joints = np.array([one.joints for one in states])
speeds = np.abs([one.speeds for one in states]).max(axis=0)
for number, name in enumerate(limits.names):
    low, high = joints[:, number].min(), joints[:, number].max()
    assert limits.lowest[number] <= low and high <= limits.highest[number] and speeds[number] <= limits.speed[number]
    print(
        f"{name:<13}{low:+.2f} to {high:+.2f} rad "
        f"(may: {limits.lowest[number]:+.2f} to {limits.highest[number]:+.2f}), "
        f"{speeds[number]:.2f} rad/s (may: {limits.speed[number]:.2f})"
    )
gaps = [np.linalg.norm(arm.plate_at(one.joints).position - palm) for one, palm in zip(states, person.palm, strict=True)]
print(f"the plate came within {1e3 * min(gaps):.0f} mm of the person's palm")
