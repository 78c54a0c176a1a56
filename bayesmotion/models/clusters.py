"""k-means: its seeding (Arthur and Vassilvitskii 2007), Lloyd's updates, and votes.

What the mixture of `mixture_ppca` begins from, and the plain alternative to it.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError

# Points whose distances are in memory together, and points that seeding looks at.
BATCH = 8192
SEEDED_FROM = 20_000


@dataclass(frozen=True)
class Clusters:
    """Centres of clusters, and how far their points lie from them.

    centre
        (K, D).
    spread
        Root mean squared distance of a point from the nearest centre.
    """

    centre: Float[np.ndarray, "k d"]
    spread: float

    def votes(self, points: Float[np.ndarray, "n d"], near: int = 5) -> Float[np.ndarray, "n k"]:
        """Divide each point's vote between its nearest centres (Agarwal and Triggs 2004).

        Parameters
        ----------
        points
            (N, D).
        near
            How many centres get a share, in proportion to exp(-distance^2 / 2 spread^2).
        """
        squared = squared_distances(points, self.centre)
        near = min(near, len(self.centre))
        chosen = np.argpartition(squared, near - 1, axis=1)[:, :near]
        least = np.take_along_axis(squared, chosen, axis=1)
        share = np.exp((least.min(axis=1, keepdims=True) - least) / (2.0 * self.spread**2))
        out = np.zeros_like(squared)
        np.put_along_axis(out, chosen, share / share.sum(axis=1, keepdims=True), axis=1)
        return out


def find_clusters(
    points: Float[np.ndarray, "n d"], count: int, *, seed: int, steps: int = 10
) -> Clusters:
    """Find clusters by k-means++ and Lloyd's updates.

    Parameters
    ----------
    points
        (N, D), in single or double precision.
    count
        K.
    seed
        Of the seeding.
    steps
        At most so many updates.

    Raises
    ------
    InputError
        If there are fewer different points than clusters.
    """
    centre = seed_centres(points, count, seed)
    for _ in range(steps):
        nearest = nearest_centre(points, centre)
        moved = _means(points, nearest, centre)
        if np.array_equal(moved, centre):
            break
        centre = moved
    total = sum(float(_least(part, centre).sum()) for part in batches(points))
    return Clusters(centre, float(np.sqrt(max(total / len(points), np.finfo(float).tiny))))


def seed_centres(
    points: Float[np.ndarray, "n d"], count: int, seed: int
) -> Float[np.ndarray, "k d"]:
    """Draw centres among the points, each far from those before (k-means++).

    Of more than `SEEDED_FROM` points only so many, drawn at random, are looked at.
    """
    random = np.random.default_rng(seed)
    if len(points) > SEEDED_FROM:
        points = points[np.sort(random.choice(len(points), SEEDED_FROM, replace=False))]
    chosen = [int(random.integers(len(points)))]
    away = squared_distances(points, points[chosen])[:, 0].astype(float)
    while len(chosen) < count:
        total = away.sum()
        if total <= 0:
            raise InputError(
                "points", f"there are fewer than {count} different ones", "Use fewer components"
            )
        chosen.append(int(random.choice(len(points), p=away / total)))
        away = np.minimum(away, squared_distances(points, points[chosen[-1:]])[:, 0])
        away[chosen] = 0.0
    return np.array(points[chosen])


def nearest_centre(
    points: Float[np.ndarray, "n d"], centre: Float[np.ndarray, "k d"]
) -> Int[np.ndarray, " n"]:
    """Tell which centre is the nearest of each point."""
    return np.concatenate(
        [squared_distances(part, centre).argmin(axis=1) for part in batches(points)]
    )


def batches(points: Float[np.ndarray, "n d"]) -> Iterator[Float[np.ndarray, "b d"]]:
    """Give the points, `BATCH` at a time."""
    for first in range(0, len(points), BATCH):
        yield points[first : first + BATCH]


def squared_distances(
    points: Float[np.ndarray, "n d"], centre: Float[np.ndarray, "k d"]
) -> Float[np.ndarray, "n k"]:
    """Give squared distances; rounding never makes them negative."""
    # Measured from the mean of the centres, so that squares hardly cancel.
    middle = centre.mean(axis=0)
    points, centre = points - middle, centre - middle
    squared = -2.0 * (points @ centre.T)
    squared += np.einsum("nd,nd->n", points, points)[:, None]
    squared += np.einsum("kd,kd->k", centre, centre)
    return np.maximum(squared, 0.0)


def _least(points: np.ndarray, centre: np.ndarray) -> np.ndarray:
    return squared_distances(points, centre).min(axis=1)


def _means(points: np.ndarray, nearest: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Move every centre to the mean of its points; one without points stays."""
    counts = np.bincount(nearest, minlength=len(centre))
    order = np.argsort(nearest, kind="stable")
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    some = counts > 0
    sums = np.add.reduceat(points[order], starts[some], axis=0, dtype=np.float64)
    moved = centre.copy()
    moved[some] = sums / counts[some, None]
    return moved
