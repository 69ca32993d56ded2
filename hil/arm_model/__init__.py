"""An arm given as data: compiled kinematics, dynamics, distances, inverse kinematics.

What an arm is comes from its folder (:mod:`highfive.hil.arm_model.arm_folder`): a MuJoCo or URDF model, which MuJoCo
compiles. May import ``model.geometry``, ``scenes`` and MuJoCo.
"""
