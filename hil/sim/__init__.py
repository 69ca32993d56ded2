"""MuJoCo: the scene, playing a pose, the contact check, rendering and the simulated pair of actors."""

# First, because MuJoCo chooses its OpenGL while it is imported.
from highfive.hil.sim import opengl as opengl
