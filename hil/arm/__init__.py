"""The servo arm in a session: loop, life cycle, planner, contact goal, emergency stop.

May import ``hil.session`` and what is below it, ``hil.drivers`` and ``hil.safety``; never a benchmark, report or
command.
"""
