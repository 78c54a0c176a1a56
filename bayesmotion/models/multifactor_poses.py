"""A trained multifactor model as the pose tasks see it: reconstruct and filter its poses.

A latent point is the content and the style vectors side by side. Along a path the content
bends as the training clips' does, and the styles stay as they are:

    log p(x) = - 1/2 sum |bend_t / bend|^2 - 1/2 sum |(s_t - s_(t-1)) / STILL|^2 + constant
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..gp.kernels import Kernel
from ..gp.linalg import AnyArray
from ..gp.matrix_normal import Conditioned
from .multifactor import Multifactor
from .poses import Frames
from .predicting import Given

# Standard deviation of a style vector's step from frame to frame; vectors are about one long.
STILL = 0.01


class MultifactorPoses(NamedTuple):
    """The interface of `tasks.latent.PoseModel`; see the module.

    kernel
        Covariance without noise.
    points
        Factors and content of the training frames.
    conditioned
        The process conditioned on them.
    scale
        (D,) of the outputs.
    bend
        (Q,) standard deviation of the content's second differences.
    candidates
        (C, T, Q + S) stretches of training clips.
    """

    kernel: Kernel
    points: dict[str, AnyArray]
    conditioned: Conditioned
    scale: Float[AnyArray, " d"]
    bend: Float[AnyArray, " q"]
    candidates: Float[AnyArray, "c t l"]

    def predict(self, x: Float[AnyArray, "m l"]) -> tuple[Float[Array, "m d"], Float[Array, "m d"]]:
        """Mean and variance (M, D) of scaled features, the noise not in it."""
        here = self._apart(jnp.asarray(x))
        cross = self.kernel.matrix(here, self.points)
        mean, covariance = self.conditioned(cross, self.kernel.matrix(here, here))
        diagonal = jnp.diagonal(covariance, axis1=1, axis2=2)
        columns = jnp.asarray(self.conditioned.missing.columns)
        variance = jnp.einsum("pm,pd->md", diagonal, columns) / jnp.asarray(self.scale) ** 2
        return mean, jnp.maximum(variance, 0.0)

    def log_prior(self, x: Float[AnyArray, "m l"]) -> Float[Array, ""]:
        """Log density of a path, up to a constant."""
        q = self.bend.shape[0]
        bend = (x[2:, :q] - 2.0 * x[1:-1, :q] + x[:-2, :q]) / self.bend
        steps = (x[1:, q:] - x[:-1, q:]) / STILL
        return -0.5 * jnp.sum(bend**2) - 0.5 * jnp.sum(steps**2)

    def _apart(self, x: Float[AnyArray, "m l"]) -> dict[str, AnyArray]:
        """Take latent points apart into the factors, the content first."""
        names = _names(self.points)
        ends = np.cumsum([self.points[name].shape[1] for name in names])[:-1]
        return dict(zip(names, jnp.split(x, ends, axis=1), strict=True))


def _names(points: Mapping[str, AnyArray]) -> list[str]:
    return ["content", *sorted(name for name in points if name != "content")]


def multifactor_poses(
    model: Multifactor,
    frames: Frames,
    given: Given,
    length: int,
    every: int = 4,
) -> MultifactorPoses:
    """Make a trained multifactor model ready for the pose tasks.

    Parameters
    ----------
    model, frames, given
        A model, its training frames, and the model conditioned on them (`Fit.given`).
    length
        Frames of the clips that tasks will be about.
    every
        Candidates begin this many frames apart in every training clip that is long enough.
    """
    points: dict[str, AnyArray] = {n: np.asarray(value) for n, value in given.points.items()}
    together = np.concatenate([points[name] for name in _names(points)], axis=1)
    clip, content = np.asarray(frames.clip), np.asarray(points["content"])
    whole = clip[2:] == clip[:-2]
    bends = (content[2:] - 2.0 * content[1:-1] + content[:-2])[whole]
    firsts = [
        first
        for first in range(0, len(clip) - length + 1, every)
        if clip[first] == clip[first + length - 1]
    ]
    return MultifactorPoses(
        model.kernel(given.hyper),
        points,
        given.conditioned,
        np.asarray(given.hyper["scale"]),
        np.sqrt(np.mean(bends**2, axis=0)),
        np.stack([together[first : first + length] for first in firsts]),
    )
