"""The processes of a shared latent model: of each view, and of the steps of its path.

A view's process is over the shared latent coordinates and, beside them, the view's own; its
equations are in `program`. Conditioned on training frames it gives new frames together where
it is exact, and each frame by itself where it goes through inducing points.
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ...distributions.dynamics import GivenSteps, Steps
from ...gp.kernels import Kernel, linear, rbf
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import Conditioned, Patterns
from ...gp.sparse import SparsePosterior


class ExactPosterior(NamedTuple):
    """A process conditioned on all training frames.

    kernel, points
        Covariance of the function, and where it was seen.
    conditioned
        What is known from there.
    beta
        Precision of the noise.
    """

    kernel: Kernel
    points: Mapping[str, AnyArray]
    conditioned: Conditioned
    beta: Float[AnyArray, ""]


Posterior = ExactPosterior | SparsePosterior


class Trained(NamedTuple):
    """A model conditioned on training frames, which new clips are seen in the light of.

    values
        Sites of one draw, ``x`` of all frames that were conditioned on among them.
    views
        For every view its process conditioned on the training frames.
    steps
        The dynamics conditioned on the training steps; None without.
    mean, scale
        Paths have dynamics as (x - mean) / scale.
    centres
        Of the back-constraint.
    """

    values: dict[str, AnyArray]
    views: dict[str, Posterior]
    steps: GivenSteps | SparsePosterior | None
    mean: Float[AnyArray, " q"]
    scale: Float[AnyArray, ""]
    centres: Float[AnyArray, "h f"]


def view_kernel(name: str, values: Mapping[str, AnyArray]) -> Kernel:
    """Return the covariance of a feature of a view, of points that `view_points` makes."""
    curved = rbf("x", variance=values[f"{name}_variance"])
    return curved + linear("x", variance=values[f"{name}_linear"])


def view_points(
    name: str,
    values: Mapping[str, AnyArray],
    x: Float[AnyArray, "n q"],
    private: Mapping[str, AnyArray],
) -> dict[str, AnyArray]:
    """Put shared and private coordinates side by side, in the view's lengths."""
    parts = [jnp.asarray(x), *([jnp.asarray(private[name])] if name in private else [])]
    return {"x": jnp.concatenate(parts, axis=1) * jnp.sqrt(values[f"{name}_gamma"])}


def view_covariance(
    name: str, values: Mapping[str, AnyArray], points: Mapping[str, AnyArray]
) -> Float[Array, "n n"]:
    """Return K (N, N) of a view's features, noise included."""
    K = view_kernel(name, values).matrix(points, points)
    return K + jnp.eye(K.shape[0]) / values[f"{name}_beta"]


def moments(
    posterior: Posterior, points: Mapping[str, AnyArray]
) -> tuple[Float[Array, "n d"], Float[Array, "p n n"]]:
    """Predict the function at new points: means, and one covariance a training pattern.

    Through inducing points frames are told each by itself: covariances are diagonal.
    """
    if isinstance(posterior, SparsePosterior):
        mean, variance = posterior(points)
        return mean, jax.vmap(jnp.diag)(variance)
    kernel = posterior.kernel
    cross, own = kernel.matrix(points, posterior.points), kernel.matrix(points, points)
    return posterior.conditioned(cross, own)


def frame_moments(
    posterior: Posterior, points: Mapping[str, AnyArray]
) -> tuple[Float[Array, "n d"], Float[Array, "p n"]]:
    """Predict the function at new points: means, and variances by training pattern."""
    if isinstance(posterior, SparsePosterior):
        return posterior(points)
    mean, covariance = moments(posterior, points)
    return mean, jnp.diagonal(covariance, axis1=1, axis2=2)


def pattern_of_columns(missing: Patterns) -> Int[Array, " d"]:
    """Return for every column of new clips which of the training patterns is its own."""
    return jnp.einsum("pd,p->d", jnp.asarray(missing.columns), missing.which).astype(int)


def unit_scale(x: Float[AnyArray, "n q"]) -> tuple[Float[Array, " q"], Float[Array, ""]]:
    """Return the mean of latent points and their root mean square about it."""
    x = jnp.asarray(x)
    mean = jnp.mean(x, axis=0)
    return mean, jnp.sqrt(jnp.mean((x - mean) ** 2))


class StepwisePath(dist.Distribution):
    """Paths (N, Q) whose every step is told by trained dynamics by itself.

    The first frame of a clip is N(0, I), others N(mean(x_{t-1}), (variance(x_{t-1}) + 1 / beta) I)
    with the moments of the process conditioned on the training steps.
    """

    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_data_fields = ("steps", "process")

    def __init__(self, process, steps: Steps, shape, *, validate_args=None):
        self.process, self.steps = process, steps
        super().__init__(batch_shape=(), event_shape=tuple(shape), validate_args=False)

    def log_prob(self, value):
        """Log density of the path `value` (N, Q)."""
        mean, sd = self._step(value[self.steps.before])
        first = dist.Normal().log_prob(value[self.steps.first]).sum()
        return first + dist.Normal(mean, sd).log_prob(value[self.steps.after]).sum()

    def sample(self, key=None, sample_shape=()):
        """Draw paths frame by frame."""
        assert key is not None, "a draw needs a key"
        white = jax.random.normal(key, (*sample_shape, *self.event_shape))
        begins = jnp.zeros(self.event_shape[0], bool).at[self.steps.first].set(True)

        def step(before, frame):
            begin, noise = frame
            mean, sd = self._step(before[None])
            here = jnp.where(begin, noise, mean[0] + sd[0] * noise)
            return here, here

        def path(noise):
            return jax.lax.scan(step, jnp.zeros(self.event_shape[1]), (begins, noise))[1]

        for _ in sample_shape:
            path = jax.vmap(path)
        return path(white)

    def _step(self, before):
        mean, variance = self.process({"x": before})
        return mean, jnp.sqrt(variance[0] + 1.0 / self.process.beta)[:, None]


class ScaledPath(dist.Distribution):
    """Paths (N, Q) that are mean + scale * z, with z of a distribution of paths."""

    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_data_fields = ("path", "mean_", "scale")

    def __init__(self, path, mean, scale, *, validate_args=None):
        self.path, self.mean_, self.scale = path, mean, scale
        super().__init__(batch_shape=(), event_shape=path.event_shape, validate_args=False)

    def log_prob(self, value):
        """Log density of the path `value` (N, Q)."""
        unit = (value - self.mean_) / self.scale
        return self.path.log_prob(unit) - value.size * jnp.log(self.scale)

    def sample(self, key=None, sample_shape=()):
        """Draw paths."""
        return self.mean_ + self.scale * self.path.sample(key, sample_shape)
