"""From a lab's recordings of two people to trials that a model learns from.

May import ``model``, ``mocap_bridge``, ``calibration`` and the avatar's skeleton.
"""
