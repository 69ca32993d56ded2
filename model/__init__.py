"""The mathematics of High Five, in rooms: ``geometry``, ``gp``, ``hgpdm``, ``online``, ``evaluation``.

May import numpy, scipy, jax and numba; never a clock, a socket, a serial port, MuJoCo, ``hil`` or ``mocap_bridge``.
"""

from highfive.model.files import DEFAULT_MODEL

__all__ = ["DEFAULT_MODEL"]
