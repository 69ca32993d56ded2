"""The safety envelope between a program and the arm: a reference that is too fast is slowed, a silent servo stops it.

The program asks for a jump of the waist by a radian, 120 rad/s. One sees what is sent instead, and which rule made it
so; then, once the servos say nothing more, that the arm brakes, and why. No port is opened. Takes 2 s.
"""

import numpy as np

from highfive.hil.arm.arm_files import limits_of
from highfive.hil.arm_model.servo_arm import default_arm
from highfive.hil.drivers.values import JointHealth, JointState
from highfive.hil.safety.envelope import step
from highfive.hil.safety.people import Human
from highfive.hil.safety.startup import Check
from highfive.hil.safety.values import Inputs, standing

arm, zero, no = default_arm(), np.zeros(6), np.zeros(6, dtype=bool)
limits = limits_of(arm.folder)
person = Human(np.array([2.0, 0.0, 1.7]), np.array([1.8, -0.2, 1.4]), zero[:3], 0)  # m, far away
now, where, heard = 10**9, np.array(limits.path[0]), 10**9
state, wanted = standing(now, 6), where + np.eye(6)[0]
for tick in range(60):
    now += round(1e9 * limits.timing.period_s)
    heard = now if tick < 40 else heard  # from then on the servos are silent
    said = JointState(heard, where, zero, zero, np.zeros(6, dtype=np.int64), ~no, no, zero)
    health, check = JointHealth(now, zero + 35.0, zero + 12.0), Check(now, ())  # °C and V; nothing is amiss
    state, command, report = step(
        limits, arm.points, state, Inputs(wanted, said, health, person, run=True, check=check), now
    )
    if command is not None:
        before, where = where, report.reference
        if tick % 8 == 0:
            speed = (where[0] - before[0]) / limits.timing.period_s
            acted = ", ".join(sorted(rule.value for rule in report.acted)) or "no rule acted"
            print(f"{8.333 * tick:4.0f} ms {report.state:<9} waist {speed:5.2f} rad/s sent: {acted}")
print(f"{report.state}: {report.reason}")
