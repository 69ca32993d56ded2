"""High Five: an avatar, or a servo arm, that meets a raised hand, in the mood you chose.

The rooms are ``highfive.model``, ``highfive.mocap_bridge``, ``highfive.calibration``, ``highfive.hil`` and
``highfive.scenes`` (docs/architecture.md).
"""

from importlib.metadata import version

__version__ = version("high-five")
