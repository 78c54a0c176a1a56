"""Shape from silhouettes: the voxels that no camera contradicts.

Voxels lie on a lattice fixed to the world: voxel (i, j, k) is the cube of side l around
((i, j, k) + 1/2) l. A camera contradicts a voxel whose centre it sees outside its
silhouette; what lies outside its picture it says nothing about. The lattice is searched
in blocks, then in blocks of half their side, and so on: a block that a camera sees wholly
outside its silhouette holds no voxel.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from ...errors import InputError
from .cameras import Camera

# Sides of the blocks in voxels.
BLOCKS = (16, 8, 4)
# Side in metres of the voxels that a subject's height is measured with.
MEASURE = 0.02
# Voxels of a subject's height, as in the paper.
PER_HEIGHT = 60


def _cube(side: int) -> np.ndarray:
    """Give the places in a cube of so many voxels, or blocks."""
    return np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


_OCTANTS, _VOXELS = _cube(2), _cube(BLOCKS[-1])


@dataclass(frozen=True)
class Region:
    """The box that is searched, in metres: lower and upper corner."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]


def region_of(cameras: Sequence[Camera]) -> Region:
    """Give the box the cameras look at.

    Around the point nearest to all optical axes, half as wide as the nearest camera is
    far, from half a metre below the lowest height at which a body may stand up to 3 m.
    """
    ahead = np.array([c.rotation[2] for c in cameras])
    place = np.array([c.place for c in cameras])
    across = np.eye(3) - ahead[:, :, None] * ahead[:, None, :]
    # With one camera, or parallel ones, any point of the axis will do: three metres ahead.
    weak = 1e-6 * np.eye(3)
    middle = np.linalg.solve(
        across.sum(axis=0) + weak,
        np.einsum("cab,cb->a", across, place) + weak @ (place + 3.0 * ahead).mean(axis=0),
    )
    reach = 0.6 * float(np.linalg.norm((place - middle)[:, [0, 2]], axis=1).min())
    x, _, z = middle
    return Region((x - reach, -0.5, z - reach), (x + reach, 3.0, z + reach))


def visual_hull(
    pictures: Sequence[Bool[np.ndarray, "height width"]],
    cameras: Sequence[Camera],
    side: float,
    region: Region | None = None,
) -> Int[np.ndarray, "n 3"]:
    """Give the voxels (n, 3) that no silhouette contradicts, as whole numbers.

    Parameters
    ----------
    pictures
        Silhouettes.
    cameras
        One for each silhouette.
    side
        Of a voxel, in metres.
    region
        The box to be searched; by default that the cameras look at. A voxel must also be
        in the picture of at least half the cameras.

    Raises
    ------
    InputError
        If there are not as many cameras as silhouettes, none at all, a silhouette has
        another size than its camera's, or the side is not positive.
    """
    if len(pictures) != len(cameras) or not cameras:
        raise InputError(
            "cameras", f"{len(pictures)} silhouettes of {len(cameras)}", "Give one of each"
        )
    for picture, camera in zip(pictures, cameras, strict=True):
        if picture.shape != (camera.height, camera.width):
            raise InputError(
                f"camera {camera.name!r}",
                f"its silhouette has the shape {picture.shape}",
                f"Give {camera.height} rows of {camera.width} pixels",
            )
    if not side > 0:
        raise InputError("side", f"it is {side}", "Give the side of a voxel in metres")
    region = region or region_of(cameras)
    sums = [_summed(picture) for picture in pictures]
    blocks = _blocks(region, side * BLOCKS[0])
    for size in BLOCKS:
        if size < BLOCKS[0]:
            blocks = (blocks[:, None, :] * 2 + _OCTANTS).reshape(-1, 3)
        blocks = _kept_blocks(blocks, sums, cameras, side * size)
    voxels = (blocks[:, None, :] * BLOCKS[-1] + _VOXELS).reshape(-1, 3)
    return _kept_voxels(voxels, pictures, cameras, side)


def _blocks(region: Region, side: float) -> np.ndarray:
    """Give all blocks that reach into the region."""
    lower = np.floor(np.array(region.lower) / side).astype(int)
    upper = np.ceil(np.array(region.upper) / side).astype(int)
    ranges = [np.arange(a, b) for a, b in zip(lower, upper, strict=True)]
    return np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 3)


def _kept_blocks(
    blocks: np.ndarray, sums: Sequence["_Sums"], cameras: Sequence[Camera], side: float
) -> np.ndarray:
    """Leave out blocks a camera sees to be empty."""
    around = np.sqrt(3.0) / 2.0 * side
    for (box, total), camera in zip(sums, cameras, strict=True):
        (u, v), depth = _pixels(camera, (blocks + 0.5) * side)
        # The block lies within a ball; its picture within a square around the centre's.
        # The extra half of it covers what a wide angle stretches at the picture's edge.
        focal = max(camera.intrinsic[0, 0], camera.intrinsic[1, 1])
        reach = 1.5 * focal * around / np.maximum(depth - around, 1e-6) + 1.0
        top, left = np.clip(v - reach, *box[0]), np.clip(u - reach, *box[1])
        bottom, right = np.clip(v + reach + 1, *box[0]), np.clip(u + reach + 1, *box[1])
        corners = [
            total[a.astype(np.int32) - box[0][0], b.astype(np.int32) - box[1][0]]
            for a in (top, bottom)
            for b in (left, right)
        ]
        seen = corners[0] - corners[1] - corners[2] + corners[3]
        outside = (u - reach < 0) | (u + reach > camera.width - 1)
        outside |= (v - reach < 0) | (v + reach > camera.height - 1)
        blocks = blocks[(seen > 0) | outside | (depth <= around)]
    return blocks


def _kept_voxels(
    voxels: np.ndarray, pictures: Sequence[np.ndarray], cameras: Sequence[Camera], side: float
) -> np.ndarray:
    """Leave out voxels a camera sees outside its silhouette."""
    seen = np.zeros(len(voxels), dtype=np.int32)
    for picture, camera in zip(pictures, cameras, strict=True):
        (u, v), depth = _pixels(camera, (voxels + 0.5) * side)
        height, width = picture.shape
        inside = (depth > 0) & (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)
        column = np.where(inside, u + 0.5, 0.0).astype(np.int32)
        row = np.where(inside, v + 0.5, 0.0).astype(np.int32)
        kept = ~inside | picture[row, column]
        voxels, seen = voxels[kept], (seen + inside)[kept]
    return voxels[2 * seen >= len(cameras)]


def _pixels(camera: Camera, points: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Give u, v and depths."""
    pixel, depth = camera.project(points)
    return (pixel[:, 0], pixel[:, 1]), depth


# The box of a silhouette, (first, last) of its rows and columns, and the sums over it.
_Sums = tuple[tuple[tuple[int, int], tuple[int, int]], np.ndarray]


def _summed(picture: np.ndarray) -> _Sums:
    """Give the box (rows, columns) of a silhouette, and the sums over it from its corner."""
    rows, columns = np.flatnonzero(picture.any(axis=1)), np.flatnonzero(picture.any(axis=0))
    if len(rows) == 0:
        return ((0, 0), (0, 0)), np.zeros((1, 1), dtype=np.int32)
    top, bottom = int(rows[0]), int(rows[-1]) + 1
    left, right = int(columns[0]), int(columns[-1]) + 1
    total = np.zeros((bottom - top + 1, right - left + 1), dtype=np.int32)
    part = np.cumsum(picture[top:bottom, left:right], axis=0, dtype=np.int32)
    np.cumsum(part, axis=1, out=total[1:, 1:])
    return ((top, bottom), (left, right)), total


def height_of(
    pictures: Sequence[Bool[np.ndarray, "height width"]],
    cameras: Sequence[Camera],
    region: Region | None = None,
    side: float = MEASURE,
) -> float:
    """Measure how tall a subject stands, in metres.

    Parameters
    ----------
    pictures, cameras, region
        As for `visual_hull`, of the first frame.
    side
        Of the voxels it is measured with, in metres.

    Raises
    ------
    InputError
        If nobody is seen.
    """
    voxels = visual_hull(pictures, cameras, side, region)
    if len(voxels) == 0:
        raise InputError(
            "silhouettes", "no voxel is seen by the cameras together", "Check the calibration"
        )
    return float(np.ptp(voxels[:, 1]) + 1) * side


def surface(voxels: Int[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Tell which voxels have an empty one among their six neighbours."""
    if len(voxels) == 0:
        return np.zeros(0, dtype=bool)
    at = voxels - voxels.min(axis=0) + 1
    full = np.zeros(at.max(axis=0) + 2, dtype=bool)
    full[tuple(at.T)] = True
    buried = np.ones(len(voxels), dtype=bool)
    for axis in range(3):
        for step in (-1, 1):
            beside = at.copy()
            beside[:, axis] += step
            buried &= full[tuple(beside.T)]
    return ~buried


def basis(voxels: Int[np.ndarray, "n 3"], cell: int = 3) -> Int[np.ndarray, "b 3"]:
    """Choose evenly among surface voxels: in each cube of voxels the one nearest their mean.

    Parameters
    ----------
    voxels
        Surface voxels.
    cell
        Side of a cube in voxels. 3 leaves about a ninth of the voxels, some 200.

    Raises
    ------
    InputError
        If the side is not at least 1.
    """
    if cell < 1:
        raise InputError("cell", f"it is {cell}", "Give a whole number of voxels, at least 1")
    if len(voxels) == 0:
        return voxels
    # Cubes are counted from the lowest corner of the body, so that a body that is moved
    # by whole voxels keeps its basis.
    cubes = (voxels - voxels.min(axis=0)) // cell
    spans = cubes.max(axis=0) + 1
    _, group = np.unique((cubes[:, 0] * spans[1] + cubes[:, 1]) * spans[2] + cubes[:, 2],
                         return_inverse=True)  # fmt: skip
    counts = np.bincount(group)
    means = np.stack([np.bincount(group, voxels[:, a]) for a in range(3)], axis=1)
    off = ((voxels - (means / counts[:, None])[group]) ** 2).sum(axis=1)
    order = np.lexsort((np.arange(len(voxels)), off, group))
    first = np.r_[0, np.cumsum(counts)[:-1]]
    return voxels[order[first]]
