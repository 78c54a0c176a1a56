"""Silhouettes against rays through every pixel, and their noise."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import skeleton_of
from bayesmotion.sensing.voxels.body import Ellipsoids, body_of, pose_body
from bayesmotion.sensing.voxels.cameras import Camera, circle
from bayesmotion.sensing.voxels.silhouettes import Noise, silhouettes, spoil


def small(camera: Camera, factor: int) -> Camera:
    """The same camera with fewer pixels."""
    K = camera.intrinsic.copy()
    K[:2] /= factor
    return Camera(
        camera.name, camera.width // factor, camera.height // factor, K, camera.rotation,
        camera.translation,
    )  # fmt: skip


def by_rays(ellipsoids: Ellipsoids, frame: int, camera: Camera) -> np.ndarray:
    """Tell for every pixel whether its ray meets an ellipsoid: the quadratic along the ray."""
    v, u = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([u.ravel(), v.ravel(), np.ones(u.size)])
    rays = camera.rotation.T @ np.linalg.inv(camera.intrinsic) @ pixels
    hit = np.zeros(u.size, dtype=bool)
    for c, B in zip(ellipsoids.centre[frame], ellipsoids.shape[frame], strict=True):
        A, d = np.linalg.inv(B), camera.place - c
        a = np.einsum("ip,ij,jp->p", rays, A, rays)
        b = d @ A @ rays
        hit |= b**2 - a * (d @ A @ d - 1.0) >= 0
    return hit.reshape(u.shape)


def test_silhouettes_are_those_of_rays(walker):
    ellipsoids = pose_body(body_of(skeleton_of(walker)), walker)
    cameras = [small(camera, 3) for camera in circle(3, first=10.0)]
    for frame in (0, 7):
        drawn = silhouettes(ellipsoids, frame, cameras)
        for picture, camera in zip(drawn, cameras, strict=True):
            assert 300 < picture.sum() < 3000
            np.testing.assert_array_equal(picture, by_rays(ellipsoids, frame, camera))


def test_a_body_at_the_edge_is_cut_off(walker):
    ellipsoids = pose_body(body_of(skeleton_of(walker)), walker)
    camera = small(circle(1, radius=3.0, target=(1.7, 0.4, 0.0))[0], 3)
    (picture,) = silhouettes(ellipsoids, 0, [camera])
    assert picture[:, 0].any()
    np.testing.assert_array_equal(picture, by_rays(ellipsoids, 0, camera))
    (nothing,) = silhouettes(ellipsoids, 0, circle(1, radius=4.0, target=(40.0, 1.0, 0.0)))
    assert not nothing.any()


def test_a_body_that_comes_too_near_is_refused(walker):
    ellipsoids = pose_body(body_of(skeleton_of(walker)), walker)
    with pytest.raises(InputError, match="too near in frame 0"):
        silhouettes(ellipsoids, 0, circle(1, radius=0.1))


def test_noise_does_what_it_says(walker):
    ellipsoids = pose_body(body_of(skeleton_of(walker)), walker)
    (picture,) = silhouettes(ellipsoids, 0, circle(1, radius=4.0))
    random = np.random.default_rng(0)
    same = spoil(picture, Noise(), random)
    np.testing.assert_array_equal(same, picture)
    wrong = spoil(picture, Noise(flips=0.1), random) ^ picture
    rows, columns = np.nonzero(picture)
    near = wrong[rows.min() - 6 : rows.max() + 7, columns.min() - 6 : columns.max() + 7]
    # Four standard errors of a binomial share.
    assert abs(near.mean() - 0.1) < 4 * np.sqrt(0.09 / near.size)
    assert near.sum() == wrong.sum()
    holed = spoil(picture, Noise(holes=2, radius=5.0), random)
    assert not (holed & ~picture).any()
    assert 20 < (picture & ~holed).sum() <= 2 * 81
    voted = spoil(picture, Noise(flips=0.1, window=5), random) ^ picture
    assert voted.sum() < 0.2 * wrong.sum()
    nothing = np.zeros_like(picture)
    assert not spoil(nothing, Noise(flips=0.2, holes=1), random).any()


@pytest.mark.parametrize("bad", [{"flips": 0.5}, {"holes": -1}, {"radius": 0.0}, {"window": 4}])
def test_noise_that_makes_no_sense_is_refused(bad):
    with pytest.raises(InputError, match="noise"):
        Noise(**bad)
