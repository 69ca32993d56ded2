"""The skeleton tracker: chain, filter, first pose, human arm, palm, joint angles. May import ``markers`` and
``files``."""
