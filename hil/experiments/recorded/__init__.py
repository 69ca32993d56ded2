"""A study's rows together with the recordings of their motion: its export, and how palms came to meet.

May import ``hil.experiments`` with its analysis, ``hil.recording`` with its exports, ``hil.sim.avatar``,
``hil.runtime`` and ``model``.
"""
