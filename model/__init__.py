"""The mathematics of High Five, in rooms: ``geometry``, ``gp``, ``hgpdm``, ``online``, ``evaluation``.

May import numpy, scipy, jax and numba; never a clock, a socket, a serial port, MuJoCo, ``hil`` or ``mocap_bridge``.
"""

from pathlib import Path

DEFAULT_MODEL = Path(__file__).with_name("default.safetensors")
"""The model that ships with the project, trained on simulated pairs (``make model``)."""
