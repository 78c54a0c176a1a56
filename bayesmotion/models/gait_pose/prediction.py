"""A trained gait-pose model: the Gaussian process from latent points to poses, and new cycles.

With K = U diag(l) U^T the training covariance without noise, and K_* that of new points
with the training points,

    mean       = K_* (K + noise I)^-1 Y,    noise = 1 / beta + subject_noise_sd^2
    covariance = K_** - (K_* R) (K_* R)^T,  R = U diag(1 / (l + noise))^(1/2).

1 / beta is what training poses are off a function that may follow every one of them. What
is a training person's own (`subject_noise_sd`) is noise to somebody new.

K of points on a surface has few eigenvalues of any size. The covariance goes by the
largest `RANK` of them, which takes the cost of a new point from N^2 to N RANK, and can only
be too large for it, next to nothing near training points. Features that miss the same
training poses share a pattern, which has an R of its own (`gp.matrix_normal`).

A new cycle has a latent path x of its own,

    x ~ closed path that bends as training cycles do (`harmonics.ClosedPaths`)
    y ~ N(mean(x), covariance(x) + noise I)        jointly over its poses,

for models of all surfaces and with dynamics too.
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from jaxtyping import Array, Float

from ...gp.kernels import Kernel
from ...gp.linalg import AnyArray
from ...gp.matrix_normal import GaussianProcess, Patterns, masked, seen_entries, smooth
from ...prediction import GPPredictive
from .data import Cycles
from .harmonics import ClosedPaths, root_mean_square_bend
from .hyperparameters import pose_kernel

RANK = 192


class LatentGP(NamedTuple):
    """What latent points say about poses.

    kernel
        Covariance without noise, on the factor ``x``.
    x
        (N, Q) training points.
    weights
        (N, D): the mean is K_* weights.
    roots
        (P, N, r), one a pattern of missing training poses: K_* root explains the variance.
    columns
        (P, D) which features each pattern is of.
    noise
        Variance of a feature about the function.
    bend
        (Q,) standard deviation of x_(t-1) - 2 x_t + x_(t+1) along the training cycles.
    paths
        (C, T, Q) latent paths of the training cycles conditioned on, some of them twice.
    """

    kernel: Kernel
    x: Float[AnyArray, "n q"]
    weights: Float[AnyArray, "n d"]
    roots: Float[AnyArray, "p n r"]
    columns: Float[AnyArray, "p d"]
    noise: Float[AnyArray, ""]
    bend: Float[AnyArray, " q"]
    paths: Float[AnyArray, "c t q"]

    def at(self, x: Float[AnyArray, "m q"]) -> tuple[Float[Array, "m d"], Float[Array, "m d"]]:
        """Return mean and variance (M, D) of poses at latent points, without the noise."""
        x = jnp.asarray(x)
        cross = self.kernel.matrix({"x": x}, {"x": jnp.asarray(self.x)})
        one = {"x": jnp.zeros(x.shape[1])}
        explained = jnp.sum(jnp.einsum("mn,pnr->pmr", cross, self.roots) ** 2, axis=2)
        variance = jnp.maximum(self.kernel(one, one) - explained, 0.0)
        return cross @ jnp.asarray(self.weights), variance.T @ jnp.asarray(self.columns)

    def jointly(
        self, x: Float[AnyArray, "m q"]
    ) -> tuple[Float[Array, "m d"], Float[Array, "p m m"]]:
        """Return the mean (M, D) and every pattern's covariance (P, M, M), without the noise."""
        points, known = {"x": jnp.asarray(x)}, {"x": jnp.asarray(self.x)}
        cross = self.kernel.matrix(points, known)
        gain = jnp.einsum("mn,pnr->pmr", cross, self.roots)
        own = self.kernel.matrix(points, points)
        return cross @ jnp.asarray(self.weights), own - jnp.einsum("pmr,plr->pml", gain, gain)

    def log_bend(self, x: Float[AnyArray, "m q"]) -> Float[Array, ""]:
        """Return the log density, up to a constant, of how the latent path of one cycle bends.

        Of its mean nothing is said.
        """
        bend = jnp.roll(x, 1, axis=0) - 2.0 * x + jnp.roll(x, -1, axis=0)
        return -0.5 * jnp.sum((bend / self.bend) ** 2)

    def path_prior(self, cycles: int, poses: int) -> ClosedPaths:
        """Return the distribution of latent paths of new cycles."""
        flat = jnp.reshape(jnp.asarray(self.paths), (-1, self.paths.shape[-1]))
        mean, sd = jnp.mean(flat, axis=0), jnp.std(flat, axis=0)
        return ClosedPaths(self.bend, mean, sd, cycles, poses)


def condition(
    frames: Cycles,
    values: Mapping[str, AnyArray],
    subject_noise_sd: float,
    cycles: Float[AnyArray, " c"] | None = None,
) -> LatentGP:
    """Condition on training poses, all of them or those of some cycles; for `jit` and `vmap`.

    Parameters
    ----------
    frames
        Training data.
    values
        Trained sites of one draw.
    subject_noise_sd
        Standard deviation of what is a person's own.
    cycles
        (C,) 1 for cycles to condition on, else 0; all where None. Shapes are the same
        whatever is chosen, so that one compilation serves all choices.
    """
    x, n, poses = jnp.asarray(values["x"]), frames.y.shape[0], frames.poses
    count = n // poses
    kept = jnp.ones(count) if cycles is None else jnp.asarray(cycles)
    rows = jnp.repeat(kept, poses)
    kernel = pose_kernel(values)
    noise = 1.0 / jnp.asarray(values["beta"]) + subject_noise_sd**2
    K = kernel.matrix({"x": x}, {"x": x})

    def one(pattern: Patterns) -> tuple[Array, Array]:
        seen = rows * pattern.rows
        noisy = masked(K + noise * jnp.eye(n), seen)
        y = seen_entries(frames.y, seen, pattern.columns)
        weights = jax.scipy.linalg.solve(noisy, y, assume_a="pos")
        size, U = jnp.linalg.eigh(seen[:, None] * seen * K)
        size, U = size[-RANK:], U[:, -RANK:]
        root = U / jnp.sqrt(jnp.maximum(size, 0.0) + noise)
        return weights, seen[:, None] * root

    every = Patterns(*map(jnp.asarray, frames.missing))
    weights, roots = jax.lax.map(one, every)
    paths = x.reshape(count, poses, -1)
    # A cycle that is not conditioned on is no place to begin from: one that is stands for it.
    order = jnp.argsort(-kept, stable=True)
    number = jnp.sum(kept).astype(int)
    stands = order[jnp.arange(count) % jnp.maximum(number, 1)]
    bend = root_mean_square_bend(paths)
    return LatentGP(
        kernel, x, jnp.sum(weights, axis=0), roots, every.columns, noise, bend, paths[stands]
    )


def new_cycles_program(frames: Cycles, trained: LatentGP) -> None:
    """Generate the features of new cycles, given the trained model."""
    n, d = frames.y.shape
    prior = trained.path_prior(n // frames.poses, frames.poses)
    x = jnp.asarray(numpyro.sample("x", prior))
    mean, covariance = trained.jointly(x)
    K = covariance + trained.noise * jnp.eye(n)
    outputs = GaussianProcess(K, jnp.ones(d), mean, frames.missing)
    numpyro.sample("y", outputs, obs=frames.y)


def predict(trained: LatentGP, frames: Cycles, values: Mapping[str, AnyArray]) -> GPPredictive:
    """Predict every entry of new cycles, conditioned on what is seen of them, at a latent path."""
    n, d = frames.y.shape
    mean, covariance = trained.jointly(values["x"])
    noise = jnp.asarray(trained.noise) * jnp.eye(n)
    mean, covariance = smooth(frames.y, mean, covariance, noise, frames.missing)
    columns = jnp.asarray(frames.missing.columns)
    return GPPredictive(mean, covariance, trained.noise, jnp.ones(d), columns)


def new_cycle_starts(
    trained: LatentGP, frames: Cycles, seed: int, count: int
) -> list[dict[str, np.ndarray]]:
    """Return latent paths of new cycles: training cycles', the likeliest ones first.

    Where more are asked for than there are training cycles, the rest are those with a tenth
    of their standard deviation of noise.
    """
    random = np.random.default_rng(seed)
    n, d = frames.y.shape
    y = np.asarray(frames.y).reshape(-1, frames.poses, d)
    rows, columns = map(np.asarray, frames.missing[:2])
    seen = np.einsum("pn,pd->nd", rows, columns).reshape(y.shape)
    paths = np.asarray(trained.paths)
    mean, variance = map(np.asarray, jax.lax.map(trained.at, jnp.asarray(paths)))
    total = variance + np.asarray(trained.noise)
    off = (y[:, None] - mean) ** 2 / total + np.log(total)
    score = np.sum(seen[:, None] * off, axis=(2, 3))  # (new, training)
    best = np.argsort(score, axis=1, kind="stable")
    sd = 0.1 * paths.reshape(-1, paths.shape[-1]).std(axis=0)
    out = []
    for number in range(count):
        rank, again = number % len(paths), number >= len(paths)
        x = paths[best[:, rank]].reshape(n, -1)
        out.append({"x": x + again * sd * random.normal(size=x.shape)})
    return out
