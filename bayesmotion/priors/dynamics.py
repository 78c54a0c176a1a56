"""Gaussian process dynamics on the latent path (GPDM, balanced GPDM).

x_t = h(x_{t-1}) + noise with a Gaussian process prior on h, one for each latent
dimension with the same covariance (Wang, Fleet, Hertzmann 2007, eq. 16)

    k(x, x') = alpha_1 exp(-alpha_2 / 2 |x - x'|^2) + alpha_3 x^T x' + delta / alpha_4.

With h integrated out, all steps of all clips are one matrix-normal; no step
leads from one clip into another. The first frame of a clip is N(0, I).

In the balanced model (Urtasun, Fleet, Fua 2006) the log density of the steps
is multiplied by D / Q, so that it weighs as much as the D observed dimensions.
"""

from functools import partial
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpyro.distributions as dist
from jaxtyping import Array, Float, Int
from numpyro.distributions import constraints

from ..gp.kernels import Kernel, linear, rbf
from ..gp.linalg import AnyArray
from ..gp.matrix_normal import Conditioned, complete, condition, log_density


class Steps(NamedTuple):
    """Where clips begin and which frame follows which.

    first
        (C,) index of the first frame of each clip.
    before, after
        (T,) indices such that frame ``after[i]`` follows frame ``before[i]``.
    """

    first: Int[AnyArray, " c"]
    before: Int[AnyArray, " t"]
    after: Int[AnyArray, " t"]


class GivenSteps(NamedTuple):
    """Steps seen in training: where they began, and the process conditioned on them."""

    alpha: Float[AnyArray, " 4"]
    x: Float[AnyArray, "t q"]
    after: Float[AnyArray, "t q"]
    conditioned: Conditioned


def kernel(alpha: Float[AnyArray, " 4"]) -> Kernel:
    """Covariance of h on the factor ``x``, without the noise 1 / alpha_4."""
    smooth = rbf("x", length_scale=alpha[1] ** -0.5, variance=alpha[0])
    return smooth + linear("x", variance=alpha[2])


def _covariance(alpha: Float[AnyArray, " 4"], x: Float[AnyArray, "t q"]) -> Float[Array, "t t"]:
    points = {"x": x}
    return kernel(alpha).matrix(points, points) + jnp.eye(len(x)) / alpha[3]


def given_steps(alpha: AnyArray, x: AnyArray, steps: Steps) -> GivenSteps:
    """Condition h on the steps of a latent path."""
    return _given(alpha, x[steps.before], x[steps.after])


def with_path(given: GivenSteps, x: AnyArray) -> GivenSteps:
    """Condition h on the steps of one path more."""
    before = jnp.concatenate([given.x, x[:-1]])
    return _given(given.alpha, before, jnp.concatenate([given.after, x[1:]]))


def _given(alpha: AnyArray, before: AnyArray, after: AnyArray) -> GivenSteps:
    whole = complete(*before.shape)
    return GivenSteps(alpha, before, after, condition(after, _covariance(alpha, before), whole))


@partial(jax.jit, static_argnames="length")
def roll_out(given: GivenSteps, x: Float[AnyArray, "m q"], length: int) -> Float[Array, "n q"]:
    """Continue a path to `length` frames, each the mean of what follows the one before."""
    weights = given.conditioned.inverse[0].T @ given.conditioned.half[0]

    def step(last, _):
        cross = kernel(given.alpha).matrix({"x": last[None]}, {"x": given.x})
        after = (cross @ weights)[0]
        return after, after

    rest = jax.lax.scan(step, x[-1], length=length - len(x))[1]
    return jnp.concatenate([x, rest])


def unit_scale(x: Float[AnyArray, "n q"]) -> Float[Array, "n q"]:
    """Scale a path to a mean square of one."""
    return jnp.asarray(x) / jnp.sqrt(jnp.mean(x**2))


class UnitScale(dist.Distribution):
    """A path's distribution seen through `unit_scale`: only the shape of x counts.

    The log density at x is that of `path` at the scaled x, and that of a standard
    normal at the logarithm of the scale itself, which keeps it proper and near one.
    """

    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_data_fields = ("path",)

    def __init__(self, path, *, validate_args=None):
        self.path = path
        super().__init__(batch_shape=(), event_shape=path.event_shape, validate_args=False)

    def log_prob(self, value):
        """Log density of the path `value` (N, Q)."""
        return self.path.log_prob(unit_scale(value)) - 0.125 * jnp.log(jnp.mean(value**2)) ** 2

    def sample(self, key, sample_shape=()):
        """Draw a path and scale it."""
        draws = self.path.sample(key, sample_shape)
        scale = jnp.sqrt(jnp.mean(draws**2, axis=(-1, -2), keepdims=True))
        return draws / scale


class GPDynamics(dist.Distribution):
    """Distribution of latent paths x (N, Q) under Gaussian process dynamics.

    Parameters
    ----------
    alpha
        (4,) hyperparameters, see the module.
    steps
        First frames and pairs of frames.
    shape
        (N, Q).
    given
        Steps seen before, that h is conditioned on; none where None.
    weight
        What the log density of the steps is multiplied by: 1, or D / Q when balanced.
        With any other weight than 1 the log density has no normaliser.
    """

    arg_constraints: ClassVar = {"alpha": constraints.positive}
    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_data_fields = ("alpha", "steps", "given")
    pytree_aux_fields = ("shape_", "weight")

    def __init__(self, alpha, steps, shape, given=None, weight=1.0, *, validate_args=None):
        self.alpha, self.steps, self.given = alpha, steps, given
        self.shape_, self.weight = tuple(shape), weight
        super().__init__(batch_shape=(), event_shape=self.shape_, validate_args=False)

    def log_prob(self, value):
        """Log density of the path `value` (N, Q)."""
        q = value.shape[1]
        start = dist.Normal().log_prob(value[self.steps.first]).sum()
        before, after = value[self.steps.before], value[self.steps.after]
        K = _covariance(self.alpha, before)
        if self.given is not None:
            cross = kernel(self.alpha).matrix({"x": before}, {"x": self.given.x})
            mean, (K,) = self.given.conditioned(cross, K)
            after = after - mean
        moves = log_density(after, K, jnp.ones(q), complete(after.shape[0], q))
        return start + self.weight * moves

    def sample(self, key=None, sample_shape=()):
        """Draw paths frame by frame, each step given all steps before it.

        The weight is not looked at: an unnormalised density has no draws of its own.
        """
        assert key is not None, "a draw needs a key"
        keys = jax.random.split(key, sample_shape) if sample_shape else key
        draw = self._one_path
        for _ in sample_shape:
            draw = jax.vmap(draw)
        return draw(keys)

    def _one_path(self, key):
        n, q = self.shape_
        white = jax.random.normal(key, (n, q))
        first, before, after = map(jnp.asarray, self.steps)
        count = len(before)

        def step(i, x):
            # Steps not drawn yet are masked out of the covariance.
            drawn = (jnp.arange(count) < i).astype(x.dtype)
            start, target = x[before], x[after]
            K = _covariance(self.alpha, start)
            here = start[i][None]
            own = _covariance(self.alpha, here)
            cross = kernel(self.alpha).matrix({"x": here}, {"x": start}) * drawn
            if self.given is not None:
                past = kernel(self.alpha).matrix({"x": start}, {"x": self.given.x})
                mean, (K,) = self.given.conditioned(past, K)
                target = target - mean
                now = past[i][None]
                shift, (own,) = self.given.conditioned(now, own)
                gain_here = now @ self.given.conditioned.inverse[0].T
                gain_past = past @ self.given.conditioned.inverse[0].T
                cross = (cross - gain_here @ gain_past.T) * drawn
            else:
                shift = jnp.zeros((1, q))
            K = drawn[:, None] * drawn[None, :] * K + jnp.diag(1.0 - drawn)
            gain = jnp.linalg.solve(K, cross.T).T
            mean = shift + gain @ (drawn[:, None] * target)
            spread = jnp.sqrt(own[0, 0] - (gain @ cross.T)[0, 0])
            return x.at[after[i]].set(mean[0] + spread * white[after[i]])

        x = jnp.zeros((n, q)).at[first].set(white[first])
        return jax.lax.fori_loop(0, count, step, x)
