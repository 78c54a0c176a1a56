"""From voxels to one feature vector a frame: shape contexts, and how a mixture shares them.

    x_f = sqrt(mean over a frame's descriptors d of p(k | d))                       (eq. 5)

with the responsibilities of a mixture of PPCA, or the votes for k-means clusters. Distances
of the roots are Hellinger's between shares: a component that takes a tenth of a share more
counts for more where it had little.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ...errors import InputError
from ...gp.linalg import AnyArray
from ...sensing.voxels.carving import Hull
from ...sensing.voxels.hull import basis
from ...sensing.voxels.shape_context import ShapeContext
from .mixture_ppca.density import Mixture, responsibilities

# Shares below this have no slope: a root's is without bounds at zero.
SMALL = 1e-12


@dataclass(frozen=True)
class Descriptors:
    """The descriptors of F frames, one frame after the other.

    values
        (N, D) in single precision.
    counts
        (F,) how many each frame has.
    """

    values: Float[np.ndarray, "n d"]
    counts: Int[np.ndarray, " f"]

    @property
    def frame(self) -> Int[np.ndarray, " n"]:
        """The number of each descriptor's frame."""
        return np.repeat(np.arange(len(self.counts)), self.counts)

    def sample(self, count: int, seed: int) -> Float[np.ndarray, "m d"]:
        """Draw so many descriptors without replacement, or return all if there are no more."""
        if len(self.values) <= count:
            return self.values
        chosen = np.random.default_rng(seed).choice(len(self.values), count, replace=False)
        return self.values[np.sort(chosen)]


def describe(
    frames: Iterable[Hull],
    context: ShapeContext,
    cell: int = 3,
    progress: Callable[[int], None] | None = None,
) -> Descriptors:
    """Describe frames of voxels.

    Parameters
    ----------
    frames
        Voxels.
    context
        The bins.
    cell
        Side in voxels of the cubes that basis voxels are chosen from, see `hull.basis`.
    progress
        Called with the frames done.

    Raises
    ------
    InputError
        If there are no frames, or one has no voxels.
    """
    found: list[np.ndarray] = []
    for frame in frames:
        shell = frame.shell
        if len(shell) == 0:
            raise InputError(f"frame {len(found)}", "it has no voxels", "Leave the frame out")
        found.append(context.describe(shell, basis(shell, cell)))
        if progress is not None:
            progress(len(found))
    if not found:
        raise InputError("voxels", "there are no frames", "Give at least one")
    return Descriptors(np.concatenate(found), np.array([len(one) for one in found]))


def mean_shares(
    descriptors: Descriptors, shares: Callable[[np.ndarray], np.ndarray]
) -> Float[np.ndarray, "f k"]:
    """Average what `shares` says of descriptors, responsibilities or votes, over each frame."""
    ends = np.cumsum(descriptors.counts)
    return np.array(
        [
            shares(descriptors.values[end - count : end]).mean(axis=0, dtype=np.float64)
            for count, end in zip(descriptors.counts, ends, strict=True)
        ]
    )


def features(
    mixture: Mixture,
    descriptors: Float[AnyArray, "n d"],
    frame: Int[AnyArray, " n"],
    frames: int,
) -> Float[Array, "f k"]:
    """Return the roots of each frame's mean responsibilities.

    Parameters
    ----------
    mixture
        The mixture.
    descriptors, frame
        Descriptors of all frames, and the number of each one's frame.
    frames
        F.
    """
    shares = responsibilities(mixture, descriptors)
    sums = jax.ops.segment_sum(shares, frame, num_segments=frames)
    counts = jax.ops.segment_sum(jnp.ones(len(shares)), frame, num_segments=frames)
    mean = sums / counts[:, None]
    some = mean > SMALL
    return jnp.where(some, jnp.sqrt(jnp.where(some, mean, 1.0)), 0.0)
