"""Who raises a hand (simulated, recorded or live), running one trial, judging it, and a session's summary.

May import ``hil.session``, ``hil.arm``, ``hil.sim``, ``hil.datasets`` and ``calibration``.
"""
