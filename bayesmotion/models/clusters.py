"""k-means, where mixtures begin from, and votes for its clusters."""

import warnings
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from sklearn.cluster import KMeans
from sklearn.exceptions import ConvergenceWarning
from sklearn.metrics import euclidean_distances, pairwise_distances_argmin

from ..errors import InputError


@dataclass(frozen=True)
class Clusters:
    """Centres of clusters, and how far their points lie from them.

    centre
        (K, D).
    sd
        Root mean squared distance of a point from the nearest centre.
    """

    centre: Float[np.ndarray, "k d"]
    sd: float

    def votes(self, points: Float[np.ndarray, "n d"], near: int = 5) -> Float[np.ndarray, "n k"]:
        """Divide each point's vote between its nearest centres (Agarwal and Triggs 2004).

        Parameters
        ----------
        points
            (N, D).
        near
            How many centres get a share, in proportion to exp(-distance^2 / 2 sd^2).
        """
        squared = euclidean_distances(points, self.centre, squared=True)
        near = min(near, len(self.centre))
        chosen = np.argpartition(squared, near - 1, axis=1)[:, :near]
        least = np.take_along_axis(squared, chosen, axis=1)
        share = np.exp((least.min(axis=1, keepdims=True) - least) / (2.0 * self.sd**2))
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
    few = InputError(
        "points", f"there are fewer than {count} different ones", "Use fewer components"
    )
    if len(points) < count:
        raise few
    means = KMeans(count, init="k-means++", max_iter=steps, random_state=seed)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ConvergenceWarning)
        try:
            means.fit(points)
        except ConvergenceWarning as warning:
            raise few from warning
    centre = np.asarray(means.cluster_centers_)
    away = -float(means.score(points)) / len(points)
    return Clusters(centre, float(np.sqrt(max(away, np.finfo(float).tiny))))


def nearest_centre(
    points: Float[np.ndarray, "n d"], centre: Float[np.ndarray, "k d"]
) -> Int[np.ndarray, " n"]:
    """Return which centre is the nearest of each point."""
    return pairwise_distances_argmin(points, centre)
