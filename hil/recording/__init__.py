"""The recording of a session (MCAP): its schemas, writing, reading back. May import ``hil.trials`` and ``hil.arm``."""
