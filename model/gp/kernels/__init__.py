"""Covariance functions as values: each a frozen dataclass, added with ``+`` and multiplied with ``*``.

A kernel is one class in one file, written for one pair of points; a line here makes it known (docs/model.md, "Adding a
kernel"). All parameters are unconstrained (logarithms), so that any real vector is a valid kernel.
"""

from highfive.model.gp.kernels.constant import Constant as Constant
from highfive.model.gp.kernels.kernel import KERNELS as KERNELS
from highfive.model.gp.kernels.kernel import Kernel as Kernel
from highfive.model.gp.kernels.kernel import Product as Product
from highfive.model.gp.kernels.kernel import Sum as Sum
from highfive.model.gp.kernels.kernel import add_jitter as add_jitter
from highfive.model.gp.kernels.kernel import register_kernel as register_kernel
from highfive.model.gp.kernels.linear import Linear as Linear
from highfive.model.gp.kernels.matern import Matern52 as Matern52
from highfive.model.gp.kernels.motion import MotionKernel as MotionKernel
from highfive.model.gp.kernels.motion import motion_kernel as motion_kernel
from highfive.model.gp.kernels.rbf import RBF as RBF
