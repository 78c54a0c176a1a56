"""Silhouettes of a body of ellipsoids, drawn exactly and without a graphics card.

The picture of an ellipsoid (c, B) under the camera P is bounded by the conic C
(Hartley and Zisserman, Multiple View Geometry, 8.3):

    C^-1 ~ P Q P^T,    Q = [[B - c c^T, -c], [-c^T, -1]]

and a pixel u = (u, v, 1) lies inside where u^T C u <= 0. In a row of pixels that is an
interval, whose ends are the roots of a quadratic; so a silhouette is a union of
intervals, of which there are rows times ellipsoids.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import uniform_filter

from ...errors import InputError
from .body import Ellipsoids
from .cameras import Camera


@dataclass(frozen=True)
class Noise:
    """What makes silhouettes imperfect.

    Parameters
    ----------
    flips
        Share of pixels in and around the body that come out wrong.
    holes
        How many round holes each silhouette has.
    radius
        Of a hole, in pixels.
    window
        Side in pixels of the square over which a majority vote cleans the silhouette
        afterwards; 1 leaves it as it is.

    Raises
    ------
    InputError
        If a number is not usable.
    """

    flips: float = 0.0
    holes: int = 0
    radius: float = 4.0
    window: int = 1

    def __post_init__(self) -> None:
        """Check the numbers once."""
        if not (0 <= self.flips < 0.5 and self.holes >= 0 and self.radius > 0):
            raise InputError("noise", f"{self}", "Give a share below 0.5, and positive numbers")
        if self.window < 1 or self.window % 2 == 0:
            raise InputError("noise", f"its window is {self.window}", "Give an odd number")


def conics(ellipsoids: Ellipsoids, frame: int, camera: Camera) -> Float[np.ndarray, "e 3 3"]:
    """Give the conics C of a frame's ellipsoids, with u^T C u <= 0 inside.

    Raises
    ------
    InputError
        If an ellipsoid is not wholly before the camera.
    """
    centre, shape = ellipsoids.centre[frame], ellipsoids.shape[frame]
    P = camera.projection
    seen = centre @ P[:, :3].T + P[:, 3]
    dual = P[:, :3] @ shape @ P[:, :3].T - seen[:, :, None] * seen[:, None, :]
    # Depth squared less its half extent squared: the ellipsoid reaches the camera's plane.
    if np.any(dual[:, 2, 2] >= 0) or np.any(seen[:, 2] <= 0):
        raise InputError(
            f"camera {camera.name!r}",
            f"the body comes too near in frame {frame}",
            "Move the camera away",
        )
    return np.linalg.inv(dual)


def silhouettes(
    ellipsoids: Ellipsoids, frame: int, cameras: Sequence[Camera]
) -> list[Bool[np.ndarray, "height width"]]:
    """Draw the silhouettes of one frame, one for each camera.

    Raises
    ------
    InputError
        If the body is not wholly before a camera.
    """
    return [_silhouette(conics(ellipsoids, frame, camera), camera) for camera in cameras]


def _silhouette(C: Float[np.ndarray, "e 3 3"], camera: Camera) -> np.ndarray:
    """Fill the intervals of all rows."""
    picture = np.zeros((camera.height, camera.width), dtype=bool)
    lowest, highest = _rows(C)
    top = max(int(np.ceil(lowest.min())), 0)
    bottom = min(int(np.floor(highest.max())), camera.height - 1)
    if bottom < top:
        return picture
    v = np.arange(top, bottom + 1)[:, None]
    a = C[:, 0, 0]
    b = C[:, 0, 1] * v + C[:, 0, 2]
    c = C[:, 1, 1] * v**2 + 2.0 * C[:, 1, 2] * v + C[:, 2, 2]
    inside = b**2 - a * c
    root = np.sqrt(np.maximum(inside, 0.0))
    first = np.maximum(np.ceil((-b - root) / a), 0.0).astype(int)
    last = np.minimum(np.floor((-b + root) / a), camera.width - 1).astype(int)
    row, _ = full = np.nonzero((inside >= 0) & (first <= last))
    if len(row) == 0:
        return picture
    first, last = first[full], last[full]
    left, right = int(first.min()), int(last.max())
    width = right - left + 2
    # How many intervals cover a pixel: those that have begun less those that have ended.
    size = (bottom - top + 1) * width
    begun = np.bincount(row * width + first - left, minlength=size)
    ended = np.bincount(row * width + last + 1 - left, minlength=size)
    covered = np.cumsum((begun - ended).reshape(-1, width), axis=1) > 0
    picture[top : bottom + 1, left : right + 1] = covered[:, :-1]
    return picture


def _rows(C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give the first and last row (not whole) each ellipse reaches."""
    # Rows where the quadratic in u has one root: its discriminant, a quadratic in v.
    a = C[:, 0, 1] ** 2 - C[:, 0, 0] * C[:, 1, 1]
    b = C[:, 0, 1] * C[:, 0, 2] - C[:, 0, 0] * C[:, 1, 2]
    c = C[:, 0, 2] ** 2 - C[:, 0, 0] * C[:, 2, 2]
    root = np.sqrt(np.maximum(b**2 - a * c, 0.0))
    return (-b + root) / a, (-b - root) / a


def spoil(
    picture: Bool[np.ndarray, "height width"], noise: Noise, random: np.random.Generator
) -> Bool[np.ndarray, "height width"]:
    """Make a silhouette imperfect: holes, then wrong pixels, then the majority vote."""
    rows, columns = np.nonzero(picture)
    if len(rows) == 0:
        return picture
    out = picture.copy()
    for hole in random.integers(len(rows), size=noise.holes):
        _punch(out, int(rows[hole]), int(columns[hole]), noise.radius)
    margin = noise.window + 5
    box = tuple(
        slice(max(place.min() - margin, 0), place.max() + margin + 1) for place in (rows, columns)
    )
    near = out[box]
    near = near ^ (random.random(near.shape) < noise.flips)
    if noise.window > 1:
        near = uniform_filter(near.astype(np.float32), noise.window, mode="nearest") > 0.5
    out[box] = near
    return out


def _punch(picture: np.ndarray, row: int, column: int, radius: float) -> None:
    reach = int(np.ceil(radius))
    top, left = max(row - reach, 0), max(column - reach, 0)
    part = picture[top : row + reach + 1, left : column + reach + 1]
    v, u = np.ogrid[: part.shape[0], : part.shape[1]]
    part[(v + top - row) ** 2 + (u + left - column) ** 2 <= radius**2] = False
