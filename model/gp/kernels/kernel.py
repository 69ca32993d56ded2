"""What every covariance function is: a value with a form for one pair of points, and its sums and products."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import partial
from typing import Any, TypeVar, cast, dataclass_transform

import jax
import jax.numpy as jnp

from highfive.model.errors import HighFiveError

jax.config.update("jax_enable_x64", True)  # the Cholesky factors of these models need double precision

JITTER = 1e-6  # added to the diagonal of an inducing covariance, relative to its mean

AnyKernel = TypeVar("AnyKernel", bound="Kernel")
KERNELS: dict[str, type[Kernel]] = {}
"""The kernels that stand for themselves, by the names of their classes; model files name them so."""


class Kernel:
    """A covariance function k(x, z) of inputs (q,).

    A subclass says :meth:`pair` and :meth:`initial`; its fields are arrays without constraints. It overrides
    :meth:`cross` where the batched pair, or its derivative, is too slow.
    """

    @classmethod
    def initial(cls, dims: int) -> Kernel:
        """The kernel that training starts from, for inputs of ``dims`` dimensions and about unit variance."""
        raise NotImplementedError

    @classmethod
    def parameters(cls) -> tuple[str, ...]:
        """Names of the fields, those of its bases first."""
        return tuple(one.name for one in fields(cast(Any, cls)))

    def pair(self, x: jax.Array, z: jax.Array) -> jax.Array:
        """k(x, z), a scalar, of one pair of inputs (q,)."""
        raise NotImplementedError

    def cross(self, a: jax.Array, b: jax.Array) -> jax.Array:
        """Covariance (A, B) of inputs (A, q) and (B, q)."""

        def row(x: jax.Array) -> jax.Array:
            return jax.vmap(partial(self.pair, x))(b)

        return jax.vmap(row)(a)

    def diagonal(self, a: jax.Array) -> jax.Array:
        """Variances (A,) of inputs (A, q)."""

        def variance(x: jax.Array) -> jax.Array:
            return self.pair(x, x)

        return jax.vmap(variance)(a)

    def __add__(self, other: Kernel) -> Sum:
        """k(x, z) + k'(x, z): the covariance of the sum of two independent functions."""
        # NotImplemented lets Python ask the other operand, or raise its own TypeError.
        return Sum(self, other) if isinstance(other, Kernel) else NotImplemented  # pyright: ignore[reportUnnecessaryIsInstance]

    def __mul__(self, other: Kernel) -> Product:
        """k(x, z) · k'(x, z): positive semi-definite by Schur's product theorem."""
        return Product(self, other) if isinstance(other, Kernel) else NotImplemented  # pyright: ignore[reportUnnecessaryIsInstance]


@dataclass_transform(frozen_default=True, eq_default=False)
def register_kernel(cls: type[AnyKernel]) -> type[AnyKernel]:
    """Makes a subclass of :class:`Kernel` a frozen dataclass, known to JAX, to model files and to the tests' laws.

    Raises:
        HighFiveError: two classes of one name.
    """
    other = KERNELS.setdefault(cls.__name__, cls)
    if (other.__module__, other.__qualname__) != (cls.__module__, cls.__qualname__):
        raise HighFiveError(
            f"two kernels are named {cls.__name__}: one in {other.__module__}, one in {cls.__module__}; rename one"
        )
    KERNELS[cls.__name__] = value = _value(cls)
    return value


@dataclass_transform(frozen_default=True, eq_default=False)
def _value(cls: type[AnyKernel]) -> type[AnyKernel]:
    """The class as a frozen dataclass whose fields JAX differentiates by."""
    value = dataclass(frozen=True, eq=False)(cls)
    return jax.tree_util.register_dataclass(value, list(value.parameters()), [])


@_value
class Sum(Kernel):
    """k(x, z) = left(x, z) + right(x, z); each keeps its own fast form."""

    left: Kernel
    right: Kernel

    def pair(self, x: jax.Array, z: jax.Array) -> jax.Array:
        """The sum of both."""
        return self.left.pair(x, z) + self.right.pair(x, z)

    def cross(self, a: jax.Array, b: jax.Array) -> jax.Array:
        """The sum of both."""
        return self.left.cross(a, b) + self.right.cross(a, b)

    def diagonal(self, a: jax.Array) -> jax.Array:
        """The sum of both."""
        return self.left.diagonal(a) + self.right.diagonal(a)


@_value
class Product(Kernel):
    """k(x, z) = left(x, z) · right(x, z); each keeps its own fast form."""

    left: Kernel
    right: Kernel

    def pair(self, x: jax.Array, z: jax.Array) -> jax.Array:
        """The product of both."""
        return self.left.pair(x, z) * self.right.pair(x, z)

    def cross(self, a: jax.Array, b: jax.Array) -> jax.Array:
        """The product of both."""
        return self.left.cross(a, b) * self.right.cross(a, b)

    def diagonal(self, a: jax.Array) -> jax.Array:
        """The product of both."""
        return self.left.diagonal(a) * self.right.diagonal(a)


def add_jitter(covariance: jax.Array) -> jax.Array:
    """The covariance (M, M) with a small multiple of its mean diagonal added to the diagonal."""
    size = covariance.shape[0]
    return covariance + (JITTER * jnp.trace(covariance) / size) * jnp.eye(size)
