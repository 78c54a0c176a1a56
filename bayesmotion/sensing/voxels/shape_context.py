"""3D shape context of voxels (Sun et al. 2006, section 4).

At a basis voxel the other surface voxels within a ball are counted in bins of the
distance r, the angle e from the vertical and the angle a about it, in the axes of the
world. Radii are spaced logarithmically (eq. 4), angles evenly:

    R_i = exp(ln R_min + i / N_r ln(R_max / R_min)),    i = 0..N_r

Votes are soft: a voxel divides its vote between the two nearest bins of each of the
three directions in proportion to how near it is to their middles; in the outermost
half bins of r and e it gives it whole. Nothing counts within R_min or beyond R_max.
A vote for a bin of volume V counts 1 / V^(1/3).

All lengths are in voxels. A voxel is a sixtieth of the subject, so neither where the
subject stands nor how large it is changes anything; which way it turns does. A voxel's
offset from the basis voxel decides its votes: they are looked up.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from ...errors import InputError
from .hull import PER_HEIGHT


@dataclass(frozen=True)
class ShapeContext:
    """Bins of the descriptor.

    Parameters
    ----------
    radial, elevation, azimuth
        Numbers of bins N_r, N_e, N_a.
    reach
        R_max as a share of the subject's height.
    inner
        R_min in voxels.

    Raises
    ------
    InputError
        If a number is not usable.
    """

    radial: int = 4
    elevation: int = 5
    azimuth: int = 10
    reach: float = 1.0 / 3.0
    inner: float = 2.0

    def __post_init__(self) -> None:
        """Check the numbers once."""
        if min(self.radial, self.elevation, self.azimuth) < 1 or not (
            0 < self.inner < self.outer <= 2 * PER_HEIGHT
        ):
            raise InputError(
                "shape context", f"{self}", "Give at least one bin each, and R_min below R_max"
            )

    @property
    def outer(self) -> float:
        """R_max in voxels."""
        return self.reach * PER_HEIGHT

    @property
    def bins(self) -> int:
        """The number D of bins."""
        return self.radial * self.elevation * self.azimuth

    @property
    def radii(self) -> Float[np.ndarray, " edges"]:
        """R_0..R_N in voxels (eq. 4)."""
        share = np.arange(self.radial + 1) / self.radial
        return np.exp(np.log(self.inner) + share * np.log(self.outer / self.inner))

    @property
    def volumes(self) -> Float[np.ndarray, "radial elevation azimuth"]:
        """Volumes of the bins in voxels."""
        shells = np.diff(self.radii**3) / 3.0
        bands = -np.diff(np.cos(np.linspace(0.0, np.pi, self.elevation + 1)))
        sector = 2.0 * np.pi / self.azimuth
        volume = shells[:, None, None] * bands[:, None] * sector
        return np.broadcast_to(volume, (self.radial, self.elevation, self.azimuth))

    def votes(self, offset: Int[np.ndarray, "n 3"]) -> sparse.csr_array:
        """Give the weighted votes (n, D) of voxels at offsets from the basis voxel."""
        x, y, z = np.asarray(offset, dtype=float).T
        r = np.sqrt(x**2 + y**2 + z**2)
        counted = (r >= self.inner) & (r < self.outer)
        safe = np.where(counted, r, self.inner)
        log_range = np.log(self.outer / self.inner)
        angle = np.arccos(np.clip(np.where(counted, y, 0.0) / safe, -1.0, 1.0))
        places = (
            _shared(self.radial * np.log(safe / self.inner) / log_range, self.radial, False),
            _shared(self.elevation * angle / np.pi, self.elevation, False),
            _shared(self.azimuth * np.arctan2(x, z) / (2.0 * np.pi), self.azimuth, True),
        )
        weight = np.cbrt(1.0 / self.volumes).ravel()
        total = sparse.csr_array((len(r), self.bins))
        shape = (self.radial, self.elevation, self.azimuth)
        for sides in np.ndindex(2, 2, 2):
            chosen = [place[side] for place, side in zip(places, sides, strict=True)]
            bins = np.ravel_multi_index([index for index, _ in chosen], shape)
            share = np.prod([part for _, part in chosen], axis=0) * counted * weight[bins]
            total = total + sparse.csr_array((share, (np.arange(len(r)), bins)), shape=total.shape)
        votes = sparse.csr_array(total)
        votes.eliminate_zeros()
        return votes

    @cached_property
    def _table(self) -> tuple[int, np.ndarray, sparse.csr_array]:
        """Give the reach in whole voxels, each offset's row of the votes, and the votes.

        Offsets run over a cube that is one voxel wider on every side, where the row is -1:
        no vote.
        """
        reach = int(np.ceil(self.outer))
        steps = np.arange(-reach - 1, reach + 2)
        offsets = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
        votes = self.votes(offsets)
        some = np.diff(votes.indptr) > 0
        rows = np.where(some, np.cumsum(some) - 1, -1).astype(np.int32)
        return reach, rows, votes[np.flatnonzero(some)].astype(np.float32)

    def describe(
        self, voxels: Int[np.ndarray, "n 3"], basis: Int[np.ndarray, "b 3"]
    ) -> Float[np.ndarray, "b d"]:
        """Give the descriptors at basis voxels, in single precision.

        Parameters
        ----------
        voxels
            Those that are counted: the surface.
        basis
            Those at which they are counted.

        Returns
        -------
        (b, D) weighted votes; bins run through azimuth first, then elevation, then radius.
        """
        reach, rows, votes = self._table
        width = 2 * reach + 3
        place = np.zeros((len(basis), len(voxels)), dtype=np.int32)
        for axis in range(3):
            apart = voxels[:, axis].astype(np.int32) - basis[:, axis, None].astype(np.int32)
            place = place * width + np.clip(apart + (reach + 1), 0, width - 1)
        place = rows[place]
        counted = place >= 0
        starts = np.concatenate([[0], np.cumsum(counted.sum(axis=1))])
        some = int(rows.max()) + 1
        ones = np.ones(starts[-1], dtype=np.float32)
        seen = sparse.csr_array((ones, place[counted], starts), shape=(len(basis), some))
        return np.asarray(sparse.csr_array(seen @ votes).toarray(), dtype=np.float32)


def _shared(
    place: Float[np.ndarray, " n"], count: int, wraps: bool
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Divide votes at `place`, in bins, between two bins: (index, share) of both."""
    below = np.floor(place - 0.5).astype(int)
    share = place - 0.5 - below
    if wraps:
        return (below % count, 1.0 - share), ((below + 1) % count, share)
    return (np.clip(below, 0, count - 1), 1.0 - share), (np.clip(below + 1, 0, count - 1), share)
