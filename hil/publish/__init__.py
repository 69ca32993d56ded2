"""A running session for other programs: LSL outlets, OSC in the VMC protocol, Foxglove's live server.

Each publisher is given every tick and event as the recorder is, in a thread of its own. May import ``hil.trials`` and
``hil.recording``; only commands and benchmarks import it.
"""
