"""From voxels to one feature vector a frame: shape contexts, and how a mixture shares them.

    x_k = mean over a frame's descriptors t of p(k | t)                       (eq. 5)

with the responsibilities of a mixture of PPCA, or the votes for k-means clusters.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError
from ..models.clusters import Clusters
from ..models.mixture_em import Mixture
from ..sensing.hull import basis
from ..sensing.shape_context import ShapeContext
from ..sensing.voxels import Hull


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

    def sample(self, count: int, seed: int) -> Float[np.ndarray, "m d"]:
        """Draw so many descriptors without replacement, or give all if there are no more."""
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


def features(descriptors: Descriptors, shares: Mixture | Clusters) -> Float[np.ndarray, "f k"]:
    """Average responsibilities, or votes, over each frame's descriptors."""
    share = shares.responsibilities if isinstance(shares, Mixture) else shares.votes
    ends = np.cumsum(descriptors.counts)
    return np.array(
        [
            share(descriptors.values[end - count : end]).mean(axis=0, dtype=np.float64)
            for count, end in zip(descriptors.counts, ends, strict=True)
        ]
    )


def rooted(x: Float[np.ndarray, "f k"]) -> Float[np.ndarray, "f k"]:
    """Give the square roots of features, whose distances are Hellinger's between shares.

    So a component that takes a tenth of a share more counts for more where it had little.
    """
    return np.sqrt(x)


def joined(parts: Sequence[Descriptors]) -> Descriptors:
    """Put the descriptors of several clips one after the other."""
    return Descriptors(
        np.concatenate([part.values for part in parts]),
        np.concatenate([part.counts for part in parts]),
    )
