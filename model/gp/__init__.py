"""Gaussian processes: kernels, the exact and the sparse posterior, the likelihood, and the optimiser.

May import ``model.geometry``.
"""
