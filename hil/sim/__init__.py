"""MuJoCo: the scene, playing a pose, the contact check, rendering and the simulated pair of actors."""
