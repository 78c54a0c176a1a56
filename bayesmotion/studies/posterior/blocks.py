"""Log densities of blocks of the training data that are left out.

For a draw theta of everything unknown the density of a block B given the rest,

    p(y_B | y_-B, theta),

is exact (`gp.leave_out`). Given draws from the posterior of all data, importance
sampling with the ratios 1 / p(y_B | y_-B, theta) turns them into draws from that without
B; where the Pareto k of a block says that this does not work, or the fit is a point
estimate, the model is fitted again without the block. Pareto k is 0 then.

Scores are log densities of angular features in radians. Their velocities are left out
with them and are not scored: they are differences of the angles and would count them
twice.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from arviz_stats.utils import ELPDDataLOO
from jaxtyping import Array, Float
from scipy.special import logsumexp

from ...evaluate.loo import SAMPLE, elpd, pareto_smoothed
from ...fit import Fit
from ...gp.leave_out import leave_out_blocks, normal_log_density
from ...gp.linalg import AnyArray
from ...inference.draws import unstacked
from ...models.multifactor.data import PoseData
from ...models.multifactor.frames import Frames, clip_labels, frames_of, seen_entries_of
from ...motion.joining import split

Refit = Callable[[xr.Dataset], Fit]


class Blocks(NamedTuple):
    """F blocks to leave out.

    rows
        (F, N) 1 where a frame is left out.
    left
        (F, D) 1 where a feature is left out of these frames.
    scored
        (F, D) 1 where it is scored too.
    """

    rows: Float[np.ndarray, "f n"]
    left: Float[np.ndarray, "f d"]
    scored: Float[np.ndarray, "f d"]


def complete_frames(
    training: PoseData, motion: xr.Dataset, seen: Mapping[str, xr.Dataset] | None = None
) -> Frames:
    """Return clips in the units of a fit that has seen less of the same clips.

    Parameters
    ----------
    training
        What the fit has seen.
    motion
        The clips as they are.
    seen
        The part of each clip that the fit has seen, where that is its beginning; time
        and heading are that part's.
    """
    encoding, levels = training.encoding, training.levels
    labels = {factor: clip_labels(motion, factor) for factor in levels}
    parts = split(motion)
    lengths = {clip: part.sizes["frame"] for clip, part in (seen or parts).items()}
    scaled = {
        clip: encoding.entries(encoding.features(part, encoding.heading((seen or parts)[clip])))
        for clip, part in parts.items()
    }
    return frames_of(scaled, labels, levels, lengths=lengths, frame_rate=encoding.frame_rate)


def frame_densities(
    training: PoseData,
    frames: Frames,
    values: Mapping[str, Array],
    block: Blocks,
    covariance: Callable[[Mapping[str, Array]], AnyArray],
) -> tuple[np.ndarray, np.ndarray]:
    """Log densities of each frame's scored features (S, N), in radians, and of the block (S,)."""
    y, rows = jnp.asarray(frames.y), jnp.asarray(block.rows)
    counted = seen_entries_of(frames) * block.scored[0]

    @jax.jit
    def every(values: dict[str, Array]) -> tuple[Array, Array]:
        def one(draw: dict[str, Array]) -> tuple[Array, Array]:
            left = leave_out_blocks(y, covariance(draw), draw["scale"], frames.missing, rows)
            each = normal_log_density(y, left.mean[0], left.variance[0])
            frame = jnp.sum(jnp.where(counted > 0, each, 0.0), axis=1)
            return frame, jnp.sum(left.log_density[0] * block.left[0])

        return jax.lax.map(one, values)

    frame, joint = every(dict(values))
    return np.asarray(frame) - counted @ np.log(training.encoding.sd), np.asarray(joint)


class Weights(NamedTuple):
    """Smoothed importance weights of the draws for each block.

    log
        (S, F) their logarithms; their sum over draws is one.
    k_hat
        (F,) Pareto k.
    good_k
        Up to where that is good.
    """

    log: Float[np.ndarray, "s f"]
    k_hat: Float[np.ndarray, " f"]
    good_k: float


def without(left: Float[np.ndarray, "s f"], shape: tuple[int, int]) -> Weights:
    """Weight draws as if blocks with these log densities had not been seen."""
    densities = unstacked(left, shape)
    likelihood = xr.Dataset({"y": ((*SAMPLE, "point"), densities)})
    # From this ArviZ takes how efficient the draws are.
    posterior = xr.Dataset({"density": (SAMPLE, densities.sum(axis=2))})
    tree = xr.DataTree.from_dict({"posterior": posterior, "log_likelihood": likelihood})
    smoothed = pareto_smoothed(tree)
    log = smoothed.log_weights.transpose(*SAMPLE, "point").values.reshape(left.shape)
    return Weights(log - logsumexp(log, axis=0), smoothed.pareto_k.values, smoothed.good_k)


def result(
    density: Float[np.ndarray, " p"],
    k_hat: Float[np.ndarray, " p"],
    coords: Mapping[str, tuple[str, np.ndarray]],
    n_samples: int,
) -> ELPDDataLOO:
    """Put scores of labelled points into ArviZ's format."""
    points = xr.DataArray(density, dims="point", coords=coords)
    return elpd(points, n_samples=n_samples, k_hat=points.copy(data=k_hat))
