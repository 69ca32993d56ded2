"""Rotations, and a skeleton of joints with its forward kinematics.

May import ``model.compiled`` and ``model.errors``.
"""
