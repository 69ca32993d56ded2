"""A High Five servo arm as a lerobot robot."""

from .config_high_five import HighFiveConfig
from .high_five import HighFive

__all__ = ["HighFive", "HighFiveConfig"]
