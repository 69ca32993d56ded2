"""Covariance functions as values: each a frozen dataclass, added with ``+`` and multiplied with ``*``.

A kernel is one class in one file, written for one pair of points; a line here makes it known (docs/model.md, "Adding a
kernel"). All parameters are unconstrained (logarithms), so that any real vector is a valid kernel.
"""

from highfive.model.gp.kernels.constant import Constant
from highfive.model.gp.kernels.kernel import KERNELS, Kernel, Product, Sum, add_jitter, register_kernel
from highfive.model.gp.kernels.linear import Linear
from highfive.model.gp.kernels.matern import Matern52
from highfive.model.gp.kernels.motion import MotionKernel, motion_kernel
from highfive.model.gp.kernels.rbf import RBF

__all__ = [
    "KERNELS",
    "RBF",
    "Constant",
    "Kernel",
    "Linear",
    "Matern52",
    "MotionKernel",
    "Product",
    "Sum",
    "add_jitter",
    "motion_kernel",
    "register_kernel",
]
