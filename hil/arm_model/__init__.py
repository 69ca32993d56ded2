"""A servo arm given as data: compiled kinematics, dynamics, distances, inverse kinematics.

May import ``model.geometry`` and ``scenes``.
"""
