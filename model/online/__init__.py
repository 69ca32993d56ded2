"""The online response to a live hand: belief, one compiled tick, responder, contact forecast, inertialization.

May import ``model.hgpdm``, ``model.gp`` and ``model.geometry``.
"""
