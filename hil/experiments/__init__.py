"""Experiments: protocols, plans drawn from them, the log of their trials.

May import ``hil.runtime``, and of ``hil.sim.people`` what emotions and cells there are.
"""
