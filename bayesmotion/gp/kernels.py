"""Covariance functions as values, written for one pair of points.

A point is a mapping from factor names to vectors, ``{"subject": (3,), "content": (2,)}``,
and every elementary kernel looks at one factor of it, so that the multifactor
product of Wang, Fleet and Hertzmann (2007, eq. 13) is written as it stands there:

>>> k = linear("subject") * linear("gait") * rbf("content", length_scale=1.0)

Kernels add and multiply; `matrix` evaluates one on two sets of points. They are
JAX pytrees: their parameters may be traced, their factor names are static.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Real

from ..errors import InputError
from .linalg import AnyArray

# Sizes are left open here: they differ from factor to factor and between two sets of
# points. `Kernel.matrix` checks what it needs itself.
Point = Mapping[str, Real[AnyArray, " _"]]
Points = Mapping[str, Real[AnyArray, "..."]]
# A parameter is a number; not checked, because JAX may put anything in its place while
# it takes a kernel apart and puts it together.
Scalar = Any


class Kernel:
    """A covariance function k(a, b) of two points; see the module for how they combine."""

    def __call__(self, a: Point, b: Point) -> Float[Array, ""]:
        """Give the covariance of the function at a and at b."""
        raise TypeError(f"{type(self).__name__} does not define a covariance")

    def __add__(self, other: "Kernel") -> "Kernel":
        """Add two independent functions."""
        return Sum(self, other)

    def __mul__(self, other: "Kernel") -> "Kernel":
        """Multiply: the features of one times the features of the other."""
        return Product(self, other)

    def matrix(self, a: Points, b: Points) -> Float[Array, "n m"]:
        """Evaluate the kernel on all pairs of the points a (n of them) and b (m of them).

        Raises
        ------
        InputError
            If a factor the kernel looks at is not among the points' factors, or is
            not a two-dimensional array, or the points have no factors at all.
        """
        for name in sorted(self.factors):
            for points in (a, b):
                if name not in points:
                    raise InputError(
                        "kernel",
                        f"it looks at the factor {name!r}, the points have {sorted(points)}",
                        "Give the points that factor or change the kernel",
                    )
                if points[name].ndim != 2:
                    raise InputError(
                        "kernel",
                        f"the factor {name!r} has shape {points[name].shape}",
                        "Give one row a point: (n, q), also when q is 1",
                    )
        rows = {name: a[name] for name in self.factors}
        columns = {name: b[name] for name in self.factors}
        if not rows:
            if not (a and b):
                raise InputError(
                    "kernel",
                    "the points have no factors, so their number is not known",
                    "Give the points one factor at least",
                )
            n, m = (next(iter(points.values())).shape[0] for points in (a, b))
            return jnp.broadcast_to(self({}, {}), (n, m))
        return self.pairs(rows, columns)

    def pairs(self, a: Points, b: Points) -> Float[Array, "n m"]:
        """Evaluate on all pairs of points that have the factors it looks at, one at least."""
        return jax.vmap(lambda p: jax.vmap(lambda q: self(p, q))(b))(a)

    @property
    def factors(self) -> frozenset[str]:
        """Names of the factors the kernel looks at."""
        return frozenset()


def _register(cls: type) -> type:
    """Make a frozen dataclass whose parameters are traced and whose factor is static."""
    return jax.tree_util.register_dataclass(dataclass(frozen=True)(cls))


def _squared_distance(a: AnyArray, b: AnyArray) -> Float[Array, ""]:
    # Expanded, so that over many pairs it becomes one matrix product; the clip
    # takes away the rounding below zero near a = b.
    return jnp.maximum(a @ a + b @ b - 2.0 * (a @ b), 0.0)


@jax.custom_vjp
def _rbf(
    A: Float[AnyArray, "n q"], B: Float[AnyArray, "m q"], sharpness: Float[AnyArray, ""]
) -> Float[Array, "n m"]:
    """Return K = exp(-sharpness |a - b|^2 / 2) of all pairs of points.

    The derivative is by hand: with W = K times what comes back, entry by entry, that by A is
    sharpness (W B - A r) of the sums r of the rows of W, and that by the sharpness -1/2 the sum
    of W |a - b|^2. Nothing (N, M) is made beside K and W.
    """
    squared = jnp.sum(A**2, axis=1)[:, None] + jnp.sum(B**2, axis=1)[None, :] - 2.0 * A @ B.T
    return jnp.exp(-0.5 * sharpness * jnp.maximum(squared, 0.0))


def _rbf_forward(A, B, sharpness):
    K = _rbf(A, B, sharpness)
    return K, (A, B, sharpness, K)


def _rbf_backward(saved, on_K):
    A, B, sharpness, K = saved
    W = on_K * K
    # The last columns sum.
    along = W @ jnp.pad(B, ((0, 0), (0, 1)), constant_values=1.0)
    across = (jnp.pad(A, ((0, 0), (0, 1)), constant_values=1.0).T @ W).T
    (of_b, r), (of_a, c) = (jnp.split(both, [A.shape[1]], axis=1) for both in (along, across))
    squares = jnp.sum(r * A**2) + jnp.sum(c * B**2) - 2.0 * jnp.sum(A * of_b)
    return sharpness * (of_b - r * A), sharpness * (of_a - c * B), -0.5 * squares


_rbf.defvjp(_rbf_forward, _rbf_backward)

# Points no farther apart than this are one point.
ROUNDING = 1e-12


def _distance(a: AnyArray, b: AnyArray) -> Float[Array, ""]:
    # The square root has no derivative at zero; the kernels that use it do. Compiled, the
    # two sides of one point may differ by rounding, and second derivatives overflow there.
    squared = jnp.sum((a - b) ** 2)
    apart = squared > ROUNDING**2
    return jnp.where(apart, jnp.sqrt(jnp.where(apart, squared, 1.0)), 0.0)


class _OneFactor(Kernel):
    factor: str

    @property
    def factors(self) -> frozenset[str]:
        """Names of the factors the kernel looks at."""
        return frozenset({self.factor})


@_register
class Linear(_OneFactor):
    """k(a, b) = variance a^T b: Bayesian linear regression on the factor."""

    factor: str = field(metadata={"static": True})
    variance: Scalar = 1.0

    def __call__(self, a: Point, b: Point) -> Float[Array, ""]:
        """Evaluate at one pair of points."""
        return self.variance * (a[self.factor] @ b[self.factor])


@_register
class RBF(_OneFactor):
    """k(a, b) = variance exp(-|a - b|^2 / (2 length_scale^2))."""

    factor: str = field(metadata={"static": True})
    length_scale: Scalar = 1.0
    variance: Scalar = 1.0

    def __call__(self, a: Point, b: Point) -> Float[Array, ""]:
        """Evaluate at one pair of points."""
        squared = _squared_distance(a[self.factor], b[self.factor])
        return self.variance * jnp.exp(-0.5 * squared / self.length_scale**2)

    def pairs(self, a: Points, b: Points) -> Float[Array, "n m"]:
        """Evaluate on all pairs; see `_rbf`."""
        sharpness = jnp.asarray(self.length_scale, dtype=float) ** -2.0
        points = (jnp.asarray(points[self.factor], dtype=float) for points in (a, b))
        return self.variance * _rbf(*points, sharpness)


@_register
class RationalQuadratic(_OneFactor):
    """k(a, b) = variance (1 + |a - b|^2 / (2 mixture length_scale^2))^-mixture."""

    factor: str = field(metadata={"static": True})
    length_scale: Scalar = 1.0
    mixture: Scalar = 1.0
    variance: Scalar = 1.0

    def __call__(self, a: Point, b: Point) -> Float[Array, ""]:
        """Evaluate at one pair of points."""
        squared = _squared_distance(a[self.factor], b[self.factor])
        base = 1.0 + 0.5 * squared / (self.mixture * self.length_scale**2)
        return self.variance * base**-self.mixture


@_register
class Matern(_OneFactor):
    """Matern kernel of smoothness 1/2, 3/2 or 5/2 (Rasmussen and Williams 2006, eq. 4.16-17)."""

    factor: str = field(metadata={"static": True})
    smoothness: float = field(default=2.5, metadata={"static": True})
    length_scale: Scalar = 1.0
    variance: Scalar = 1.0

    def __call__(self, a: Point, b: Point) -> Float[Array, ""]:
        """Evaluate at one pair of points."""
        r = jnp.sqrt(2.0 * self.smoothness) * _distance(a[self.factor], b[self.factor])
        r = r / self.length_scale
        polynomial = {0.5: 1.0, 1.5: 1.0 + r, 2.5: 1.0 + r + r**2 / 3.0}[self.smoothness]
        return self.variance * polynomial * jnp.exp(-r)


@_register
class Periodic(_OneFactor):
    """k = variance exp(-2 sum sin^2(pi (a - b) / period) / length_scale^2) (MacKay 1998)."""

    factor: str = field(metadata={"static": True})
    period: Scalar = 1.0
    length_scale: Scalar = 1.0
    variance: Scalar = 1.0

    def __call__(self, a: Point, b: Point) -> Float[Array, ""]:
        """Evaluate at one pair of points."""
        sines = jnp.sin(jnp.pi * (a[self.factor] - b[self.factor]) / self.period)
        return self.variance * jnp.exp(-2.0 * jnp.sum(sines**2) / self.length_scale**2)


@_register
class Bias(Kernel):
    """k(a, b) = variance: one unknown constant."""

    variance: Scalar = 1.0

    def __call__(self, a: Point, b: Point) -> Float[Array, ""]:
        """Evaluate at one pair of points."""
        return jnp.asarray(self.variance, dtype=float)

    def pairs(self, a: Points, b: Points) -> Float[Array, "n m"]:
        """Evaluate on all pairs of points of any factors."""
        n, m = (next(iter(points.values())).shape[0] for points in (a, b))
        return jnp.broadcast_to(jnp.asarray(self.variance, dtype=float), (n, m))


@_register
class White(_OneFactor):
    """k(a, b) = variance where the factor is the same to the last bit, else 0.

    Give it a factor that numbers the measurements: noise belongs to a
    measurement, and two frames may share all their other coordinates.
    """

    factor: str = field(metadata={"static": True})
    variance: Scalar = 1.0

    def __call__(self, a: Point, b: Point) -> Float[Array, ""]:
        """Evaluate at one pair of points."""
        return self.variance * jnp.all(a[self.factor] == b[self.factor])


@_register
class Sum(Kernel):
    """k = left + right."""

    left: Kernel
    right: Kernel

    @property
    def factors(self) -> frozenset[str]:
        """Names of the factors the kernel looks at."""
        return self.left.factors | self.right.factors

    def __call__(self, a: Point, b: Point) -> Float[Array, ""]:
        """Evaluate at one pair of points."""
        return self.left(a, b) + self.right(a, b)

    def pairs(self, a: Points, b: Points) -> Float[Array, "n m"]:
        """Evaluate on all pairs."""
        return self.left.pairs(a, b) + self.right.pairs(a, b)


@_register
class Product(Kernel):
    """k = left right (Wang, Fleet, Hertzmann 2007, eq. 13 for two factors)."""

    left: Kernel
    right: Kernel

    @property
    def factors(self) -> frozenset[str]:
        """Names of the factors the kernel looks at."""
        return self.left.factors | self.right.factors

    def __call__(self, a: Point, b: Point) -> Float[Array, ""]:
        """Evaluate at one pair of points."""
        return self.left(a, b) * self.right(a, b)

    def pairs(self, a: Points, b: Points) -> Float[Array, "n m"]:
        """Evaluate on all pairs."""
        return self.left.pairs(a, b) * self.right.pairs(a, b)


def matern(factor: str, smoothness: float = 2.5, **parameters: Scalar) -> Matern:
    """Make a Matern kernel on `factor`.

    Raises
    ------
    InputError
        If the smoothness is not 0.5, 1.5 or 2.5.
    """
    if smoothness not in (0.5, 1.5, 2.5):
        raise InputError(
            "matern", f"the smoothness is {smoothness}", "Use 0.5, 1.5 or 2.5, or rbf for infinity"
        )
    return Matern(factor, smoothness, **parameters)


linear: Callable[..., Linear] = Linear
rbf: Callable[..., RBF] = RBF
rational_quadratic: Callable[..., RationalQuadratic] = RationalQuadratic
periodic: Callable[..., Periodic] = Periodic
bias: Callable[..., Bias] = Bias
white: Callable[..., White] = White
