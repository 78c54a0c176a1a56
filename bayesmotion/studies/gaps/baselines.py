"""What others do about gaps of markers: splines, rigid clusters, principal components.

Each takes positions (T, M, 3) with NaN and returns them with what it fills in.
"""

import importlib.util
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import CubicSpline

from ...gp.marker_gaps import aligned, runs

Fill = Callable[[Float[np.ndarray, "t m 3"]], Float[np.ndarray, "t m 3"]]
CLUSTER = 3  # markers of a cluster
EXPLAINED = 0.995  # of the variance, by the principal components that are kept


def spline(position: Float[np.ndarray, "t m 3"]) -> Float[np.ndarray, "t m 3"]:
    """Fill in by cubic splines through all that is known of a marker."""
    out = position.copy()
    for marker in range(position.shape[1]):
        known = np.isfinite(position[:, marker, 0])
        lost = np.flatnonzero(~known)
        if len(lost):
            path = CubicSpline(np.flatnonzero(known), position[known, marker])
            out[lost, marker] = path(lost)
    return out


def rigid(position: Float[np.ndarray, "t m 3"]) -> Float[np.ndarray, "t m 3"]:
    """Fill in as if a marker were fixed to the three that keep its distance best.

    Their pose carries it from the nearest frame in which it is known, as MStudio does from three
    reference markers.
    """
    return _by_clusters(position, _carried)


def principal_components(position: Float[np.ndarray, "t m 3"]) -> Float[np.ndarray, "t m 3"]:
    """Fill in by principal components of whole frames (Federolf 2013; Gloersen and Federolf 2016).

    Markers are taken relative to the mean of those that are always seen. With V the components
    of whole frames, and V_0 those of the same frames with the missing columns at zero, a frame
    z of which they are missing is ``z V_0 V_0^T V V^T``. What is filled in is moved so that it
    joins what is known at the ends.
    """
    seen = np.isfinite(position).all(axis=-1)
    always = seen.all(axis=0)
    middle = position[:, always].mean(axis=1, keepdims=True)
    y = (position - middle).reshape(len(position), -1)
    lost = np.repeat(~seen.all(axis=0), 3)
    whole = seen.all(axis=1)
    mean, sd = y[whole].mean(axis=0), y[whole].std(axis=0).mean()
    z = (y - mean) / sd
    full, cut = z[whole], np.where(lost, 0.0, z[whole])
    V, V0 = _components(full), _components(cut)
    made = np.where(lost, 0.0, z) @ V0 @ (V0.T @ V) @ V.T * sd + mean
    filled = made.reshape(position.shape) + middle
    out = position.copy()
    for marker in np.flatnonzero(~always):
        for gap in runs(~seen[:, marker]):
            out[gap, marker] = filled[gap, marker] + _joining(position, filled, int(marker), gap)
    return out


def gapfill_pattern(position: Float[np.ndarray, "t m 3"]) -> Float[np.ndarray, "t m 3"]:
    """Fill in by the package gapfill, after the marker whose distance changes least."""
    from gapfill import fill_marker_gap_pattern2  # pyright: ignore[reportMissingImports]

    def fill(own: np.ndarray, cluster: np.ndarray, gap: np.ndarray) -> np.ndarray:
        fill_marker_gap_pattern2(own, cluster[:, 0])
        return own[gap]

    return _by_clusters(position, fill)


def gapfill_rigid(position: Float[np.ndarray, "t m 3"]) -> Float[np.ndarray, "t m 3"]:
    """Fill in by the package gapfill, with a rigid cluster of three markers."""
    from gapfill import fill_marker_gap_rbt  # pyright: ignore[reportMissingImports]

    def fill(own: np.ndarray, cluster: np.ndarray, gap: np.ndarray) -> np.ndarray:
        fill_marker_gap_rbt(own, cluster.transpose(1, 0, 2))
        return own[gap]

    return _by_clusters(position, fill)


def baselines() -> dict[str, Fill]:
    """Return what is compared with; the package gapfill where it is installed."""
    found: dict[str, Fill] = {
        "spline": spline, "rigid": rigid, "principal_components": principal_components,
    }  # fmt: skip
    if importlib.util.find_spec("gapfill") is not None:
        found |= {"gapfill_pattern": gapfill_pattern, "gapfill_rigid": gapfill_rigid}
    return found


def _by_clusters(
    position: Float[np.ndarray, "t m 3"],
    fill: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
) -> Float[np.ndarray, "t m 3"]:
    """Fill in each gap from the always seen markers whose distances from it vary least."""
    seen = np.isfinite(position).all(axis=-1)
    always = np.flatnonzero(seen.all(axis=0))
    out = position.copy()
    for marker in np.flatnonzero(~seen.all(axis=0)):
        known = seen[:, marker]
        apart = position[known][:, always] - position[known, marker][:, None]
        steady = np.argsort(np.linalg.norm(apart, axis=-1).std(axis=0))[:CLUSTER]
        for gap in runs(~known):
            out[gap, marker] = fill(position[:, marker].copy(), position[:, always[steady]], gap)
    return out


def _carried(
    own: Float[np.ndarray, "t 3"], cluster: Float[np.ndarray, "t c 3"], gap: Int[np.ndarray, " g"]
) -> Float[np.ndarray, "g 3"]:
    known = np.flatnonzero(np.isfinite(own[:, 0]))
    out = np.empty((len(gap), 3))
    for row, frame in enumerate(gap):
        near = known[np.abs(known - frame).argmin()]
        turn, place = aligned(cluster[frame][None], cluster[near])
        out[row] = turn[0] @ own[near] + place[0]
    return out


def _components(rows: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "d k"]:
    values, vectors = np.linalg.eigh(np.cov(rows.T))
    share = np.cumsum(values[::-1]) / values.sum()
    return vectors[:, ::-1][:, : int(np.searchsorted(share, EXPLAINED)) + 1]


def _joining(
    position: Float[np.ndarray, "t m 3"], filled: Float[np.ndarray, "t m 3"], marker: int,
    gap: Int[np.ndarray, " g"],
) -> Float[np.ndarray, "g 3"]:  # fmt: skip
    """Return what leads from what is known before a gap to what is known after it."""
    ends = [end for end in (gap[0] - 1, gap[-1] + 1) if 0 <= end < len(position)]
    away = position[ends, marker] - filled[ends, marker]
    if len(ends) == 1:
        return np.repeat(away, len(gap), axis=0)
    share = (np.arange(len(gap)) + 1.0)[:, None] / (len(gap) + 1.0)
    return (1.0 - share) * away[0] + share * away[1]
