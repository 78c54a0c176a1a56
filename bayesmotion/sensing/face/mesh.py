"""The mesh of a face: its texture taken off a picture, and painted onto one.

The landmarks of a reference shape are joined to triangles (Delaunay 1934). A point p of the
reference in the triangle of landmarks i, j, k is p = u r_i + v r_j + w r_k with u + v + w = 1;
in a picture whose landmarks are x it lies at u x_i + v x_j + w x_k: the piecewise affine warp.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import distance_transform_edt, map_coordinates
from scipy.spatial import Delaunay

from ...errors import InputError

MARGIN = 2.0  # pixels around the reference
EDGE = 1e-9  # barycentric weights down to this below zero count as inside
FLAT = 1e-9  # pixels^2: triangles smaller than this are not painted


@dataclass(frozen=True)
class Mesh:
    """A reference shape, its triangles, and where its pixels lie in them.

    reference
        (L, 2) landmarks x, y in pixels of the reference picture.
    triangles
        (F, 3) landmarks of every triangle.
    pixels
        (P, 2) rows and columns of the reference's pixels inside the mesh.
    corners
        (P, 3) landmarks of the triangle around every pixel.
    weights
        (P, 3) barycentric weights of every pixel.
    """

    reference: Float[np.ndarray, "l 2"]
    triangles: Int[np.ndarray, "f 3"]
    pixels: Int[np.ndarray, "p 2"]
    corners: Int[np.ndarray, "p 3"]
    weights: Float[np.ndarray, "p 3"]

    @property
    def size(self) -> tuple[int, int]:
        """Give height and width of the reference picture."""
        width, height = np.ceil(self.reference.max(axis=0) + MARGIN).astype(int) + 1
        return int(height), int(width)


def make_mesh(shape: Float[np.ndarray, "l 2"], scale: float = 1.0) -> Mesh:
    """Join the landmarks of a shape to a mesh.

    Parameters
    ----------
    shape
        The reference, wherever it lies.
    scale
        Pixels of the reference picture for a pixel of the shape.

    Raises
    ------
    InputError
        If the landmarks lie on a line, or the reference has no pixel.
    """
    reference = (shape - shape.min(axis=0)) * scale + MARGIN
    if len(shape) < 3 or np.linalg.matrix_rank(reference - reference.mean(axis=0), tol=1e-6) < 2:
        raise InputError("landmarks", "they lie on a line", "Mark the outline of the face too")
    joined = Delaunay(reference)
    triangles = joined.simplices.astype(int)
    empty = np.empty((0, 3))
    mesh = Mesh(reference, triangles, empty[:, :2].astype(int), empty.astype(int), empty)
    rows, columns = np.indices(mesh.size).reshape(2, -1)
    points = np.stack([columns, rows], axis=1).astype(float)
    inside = joined.find_simplex(points)
    points, found = points[inside >= 0], inside[inside >= 0]
    if len(found) == 0:
        raise InputError("landmarks", "their reference has no pixel", "Give a larger scale")
    corners = triangles[found]
    weights = barycentric(points, reference[corners])
    return Mesh(reference, triangles, points[:, ::-1].astype(int), corners, weights)


def barycentric(
    points: Float[np.ndarray, "p 2"], corners: Float[np.ndarray, "p 3 2"]
) -> Float[np.ndarray, "p 3"]:
    """Give the weights with which the corners of triangles make up points."""
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    to = points - corners[:, 0]
    area = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    v = (to[:, 0] * other[:, 1] - to[:, 1] * other[:, 0]) / area
    w = (one[:, 0] * to[:, 1] - one[:, 1] * to[:, 0]) / area
    return np.stack([1.0 - v - w, v, w], axis=1)


def take_texture(
    mesh: Mesh, picture: Float[np.ndarray, "h w c"], shape: Float[np.ndarray, "l 2"]
) -> Float[np.ndarray, "p c"]:
    """Take the colours under a mesh off a picture; outside the picture its edge goes on.

    Parameters
    ----------
    picture
        Any number of channels.
    shape
        Landmarks x, y in pixels of the picture; pixel centres are whole numbers.
    """
    at = np.einsum("pk,pkx->px", mesh.weights, shape[mesh.corners])
    return _looked_up(picture, at)


def paint_texture(
    mesh: Mesh,
    texture: Float[np.ndarray, "p c"],
    shape: Float[np.ndarray, "l 2"],
    background: Float[np.ndarray, "h w c"],
) -> Float[np.ndarray, "h w c"]:
    """Paint a texture onto a picture, under a mesh that lies there as a shape says."""
    reference = np.zeros((*mesh.size, texture.shape[1]))
    reference[mesh.pixels[:, 0], mesh.pixels[:, 1]] = texture
    reference = _grown(mesh, reference)
    picture = background.copy()
    places, origins = [np.empty((0, 2), dtype=int)], [np.empty((0, 2))]
    for triangle in mesh.triangles:
        corners = shape[triangle]
        one, other = corners[1] - corners[0], corners[2] - corners[0]
        if abs(one[0] * other[1] - one[1] * other[0]) < FLAT:
            continue
        points = _box(corners, *picture.shape[:2])
        weights = barycentric(points, np.broadcast_to(corners, (len(points), 3, 2)))
        inside = (weights >= -EDGE).all(axis=1)
        places.append(points[inside].astype(int))
        origins.append(weights[inside] @ mesh.reference[triangle])
    at, origin = np.concatenate(places), np.concatenate(origins)
    picture[at[:, 1], at[:, 0]] = _looked_up(reference, origin)
    return picture


def _box(corners: np.ndarray, height: int, width: int) -> np.ndarray:
    """Give the pixels x, y of a picture that may lie in a triangle."""
    low = np.maximum(np.ceil(corners.min(axis=0) - EDGE), 0).astype(int)
    high = np.minimum(np.floor(corners.max(axis=0) + EDGE), (width - 1, height - 1)).astype(int)
    columns, rows = np.meshgrid(
        np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1), indexing="ij"
    )
    return np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float)


def _looked_up(picture: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Interpolate a picture bilinearly at points x, y."""
    return np.stack(
        [
            map_coordinates(picture[..., channel], at[:, ::-1].T, order=1, mode="nearest")
            for channel in range(picture.shape[-1])
        ],
        axis=1,
    )


def _grown(mesh: Mesh, reference: np.ndarray) -> np.ndarray:
    """Let the colours at the mesh's edge go on outside, so that none of the empty seeps in."""
    outside = np.ones(mesh.size, dtype=bool)
    outside[mesh.pixels[:, 0], mesh.pixels[:, 1]] = False
    nearest = np.asarray(
        distance_transform_edt(outside, return_distances=False, return_indices=True)
    )
    return reference[nearest[0], nearest[1]]
