"""The mathematics of High Five: rotations, skeleton, kernels, Gaussian processes, the hierarchy and its response."""
