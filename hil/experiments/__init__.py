"""Experiments with people: protocols, plans drawn from them, the log of their trials, and what is found out from them.

May import ``hil.runtime``, and of ``hil.sim.people`` what emotions and cells there are; ``analysis`` only ``model``.
"""
