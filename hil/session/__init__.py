"""One tick of a session, markers in and corrected pose out: reach, contact correction, style timing, synchroniser.

May import ``model``, ``mocap_bridge``, ``hil.sim`` and ``hil.runtime``.
"""
