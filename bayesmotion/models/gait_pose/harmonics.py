"""The harmonics of a cycle of T poses: its orthonormal cosines and sines.

A path of a whole cycle has independent harmonics under any prior that does not care where
the cycle begins. The bends x_(t-1) - 2 x_t + x_(t+1) of a closed path are then

    bend of harmonic k = -(2 - 2 cos(2 pi k / T)) z_k,

so that independent bends ~ N(0, bend^2) are z_k ~ N(0, (bend / (2 - 2 cos ..))^2). They say
nothing of the path's mean (k = 0), which has a normal distribution of its own.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ...gp.linalg import AnyArray


def harmonics_of(poses: int) -> tuple[Int[np.ndarray, " t"], Float[np.ndarray, "t t"]]:
    """Return the number of each harmonic (T,), and the harmonics, orthonormal, one a row (T, T).

    Harmonic k goes round k times in a cycle.
    """
    row, at = np.arange(poses), np.arange(poses)
    number = (row + 1) // 2
    angle = 2.0 * np.pi * number[:, None] * at / poses
    waves = np.where((row % 2 == 1)[:, None], np.cos(angle), np.sin(angle))
    waves[0] = 1.0
    return number, waves / np.linalg.norm(waves, axis=1, keepdims=True)


class ClosedPaths(dist.Distribution):
    """The distribution of latent paths x (N, Q) of whole cycles, which close.

    Parameters
    ----------
    bend
        (Q,) standard deviation of x_(t-1) - 2 x_t + x_(t+1).
    loc, scale
        (Q,) mean and standard deviation of the mean of a cycle's path.
    cycles, poses
        How many cycles, and T: N = cycles T.
    """

    arg_constraints: ClassVar = {}
    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_data_fields = ("bend", "loc", "scale")
    pytree_aux_fields = ("cycles", "poses")

    def __init__(self, bend, loc, scale, cycles, poses, *, validate_args=None):
        self.bend, self.loc, self.scale = map(jnp.asarray, (bend, loc, scale))
        self.cycles, self.poses = cycles, poses
        super().__init__(
            batch_shape=(), event_shape=(cycles * poses, self.bend.shape[-1]), validate_args=False
        )

    def log_prob(self, value):
        """Log density of the paths `value` (N, Q)."""
        loc, sd, waves = self._harmonics()
        paths = jnp.reshape(value, (self.cycles, self.poses, -1))
        z = jnp.einsum("jt,ctq->cjq", waves, paths)
        return jnp.sum(dist.Normal(loc, sd).log_prob(z))

    def sample(self, key=None, sample_shape=()):
        """Draw paths."""
        assert key is not None, "a draw needs a key"
        loc, sd, waves = self._harmonics()
        q = loc.shape[1]
        white = jax.random.normal(key, (*sample_shape, self.cycles, self.poses, q))
        paths = jnp.einsum("jt,...jq->...tq", waves, loc + sd * white)
        return paths.reshape(*sample_shape, *self.event_shape)

    def _harmonics(self) -> tuple[Array, Array, np.ndarray]:
        """Return mean and standard deviation (T, Q) of the harmonics, and these."""
        number, waves = harmonics_of(self.poses)
        curved = 2.0 - 2.0 * np.cos(2.0 * np.pi * number / self.poses)
        still = (number == 0)[:, None]
        root = float(np.sqrt(self.poses))
        bends = self.bend / np.where(number == 0, 1.0, curved)[:, None]
        loc = jnp.where(still, root * self.loc, 0.0)
        return loc, jnp.where(still, root * self.scale, bends), waves


def root_mean_square_bend(paths: Float[AnyArray, "c t q"]) -> Float[Array, " q"]:
    """Return the root mean square (Q,) of the bends along closed paths."""
    x = jnp.asarray(paths)
    bends = jnp.roll(x, 1, axis=1) - 2.0 * x + jnp.roll(x, -1, axis=1)
    return jnp.sqrt(jnp.mean(bends**2, axis=(0, 1)))
