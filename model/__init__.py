"""The mathematics of High Five: rotations, the skeleton, kernels, Gaussian processes, the hierarchy and its response."""
