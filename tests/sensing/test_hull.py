"""Visual hulls against brute force over the whole lattice, and what is made of them."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import skeleton_of
from bayesmotion.sensing.voxels.body import body_of, pose_body
from bayesmotion.sensing.voxels.cameras import circle
from bayesmotion.sensing.voxels.carving import carve, hulls, load_voxels, save_voxels
from bayesmotion.sensing.voxels.hull import (
    Region,
    basis,
    height_of,
    region_of,
    surface,
    visual_hull,
)
from bayesmotion.sensing.voxels.silhouettes import Noise, silhouettes

REGION = Region((-0.8, -0.2, -0.8), (0.8, 2.2, 0.8))


@pytest.fixture(scope="module")
def body(walker):
    return pose_body(body_of(skeleton_of(walker)), walker)


def brute(pictures, cameras, side) -> set:
    lower, upper = (np.array(corner) for corner in (REGION.lower, REGION.upper))
    first, last = np.floor(lower / side / 16) * 16, np.ceil(upper / side / 16) * 16
    ranges = [np.arange(a, b) for a, b in zip(first, last, strict=True)]
    lattice = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 3)
    kept, seen = np.ones(len(lattice), dtype=bool), np.zeros(len(lattice))
    for picture, camera in zip(pictures, cameras, strict=True):
        pixel, depth = camera.project((lattice + 0.5) * side)
        u, v = np.floor(pixel + 0.5).astype(int).T
        inside = (depth > 0) & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
        clear = np.ones(len(lattice), dtype=bool)
        clear[inside] = picture[v[inside], u[inside]]
        kept &= clear
        seen += inside
    return set(map(tuple, lattice[kept & (2 * seen >= len(cameras))].astype(int)))


@pytest.mark.parametrize("count", [2, 5])
def test_blocks_leave_nothing_out(body, count):
    cameras = circle(count, first=15.0)
    pictures = silhouettes(body, 3, cameras)
    found = visual_hull(pictures, cameras, 0.04, REGION)
    assert len(found) > 500
    assert set(map(tuple, found)) == brute(pictures, cameras, 0.04)


def test_voxels_that_a_camera_does_not_see_are_left_to_the_others(body):
    cameras = [*circle(4), *circle(1, radius=2.5, target=(0.3, 1.7, 0.0))]
    pictures = silhouettes(body, 0, cameras)
    found = set(map(tuple, visual_hull(pictures, cameras, 0.04, REGION)))
    assert found == brute(pictures, cameras, 0.04)
    assert min(y for _, y, _ in found) < 5  # the feet, which the last camera does not see


def test_the_hull_holds_the_body_and_more_cameras_carve_more(body):
    sizes = []
    for count in (3, 6, 12):
        cameras = circle(count)
        voxels = visual_hull(silhouettes(body, 0, cameras), cameras, 0.03)
        sizes.append(len(voxels))
        inside = set(map(tuple, voxels))
        # A voxel whose centre is well inside an ellipsoid is kept.
        for c, B in zip(body.centre[0], body.shape[0], strict=True):
            near = np.floor(c / 0.03).astype(int)
            off = (near + 0.5) * 0.03 - c
            assert off @ np.linalg.inv(B) @ off > 0.6 or tuple(near) in inside
    assert sizes[0] > sizes[1] > sizes[2]


def test_the_height_is_measured(body):
    cameras = circle(6)
    tops = body.centre[0, :, 1] + np.sqrt(body.shape[0, :, 1, 1])
    bottoms = body.centre[0, :, 1] - np.sqrt(body.shape[0, :, 1, 1])
    measured = height_of(silhouettes(body, 0, cameras), cameras)
    assert abs(measured - (tops.max() - bottoms.min())) < 0.04


def test_the_region_is_where_the_cameras_look():
    region = region_of(circle(5, radius=4.0, target=(2.0, 1.0, -1.0)))
    np.testing.assert_allclose(region.lower, (2.0 - 2.4, -0.5, -1.0 - 2.4))
    np.testing.assert_allclose(region.upper, (2.0 + 2.4, 3.0, -1.0 + 2.4))


def test_surface_of_a_cube():
    cube = np.stack(np.meshgrid(*[np.arange(-2, 3)] * 3), axis=-1).reshape(-1, 3)
    buried = np.abs(cube).max(axis=1) < 2
    np.testing.assert_array_equal(surface(cube), ~buried)
    assert surface(cube[:0]).shape == (0,)


def test_basis_voxels_are_surface_voxels_one_a_cube():
    random = np.random.default_rng(0)
    shell = np.unique(random.integers(-9, 9, size=(400, 3)), axis=0)
    chosen = basis(shell, 3)
    assert {tuple(v) for v in chosen} <= {tuple(v) for v in shell}
    cubes = (chosen - shell.min(axis=0)) // 3
    assert len(np.unique(cubes, axis=0)) == len(chosen)
    assert len(chosen) == len(np.unique((shell - shell.min(axis=0)) // 3, axis=0))
    by = np.array([5, -7, 2])
    np.testing.assert_array_equal(basis(shell + by, 3), chosen + by)
    np.testing.assert_array_equal(basis(shell, 1), shell[np.lexsort(shell.T[::-1])])
    with pytest.raises(InputError, match="cell"):
        basis(shell, 0)


def test_what_cannot_be_carved_is_refused(body):
    cameras = circle(2)
    pictures = silhouettes(body, 0, cameras)
    with pytest.raises(InputError, match="2 silhouettes of 1"):
        visual_hull(pictures, cameras[:1], 0.05)
    with pytest.raises(InputError, match="has the shape"):
        visual_hull([pictures[0], pictures[1][1:]], cameras, 0.05)
    with pytest.raises(InputError, match="side"):
        visual_hull(pictures, cameras, 0.0)
    with pytest.raises(InputError, match="no voxel"):
        height_of([np.zeros_like(p) for p in pictures], cameras)


def test_voxels_of_a_clip_are_saved_and_read(walker, six, tmp_path):
    walk = walker.isel(frame=slice(0, 4))
    voxels = carve(walk, six, seed=0)
    found = list(hulls(voxels))
    assert len(found) == 4
    assert sum(len(h.voxels) for h in found) == voxels.sizes["count"]
    for hull in found:
        np.testing.assert_array_equal(hull.surface, surface(hull.voxels))
        # A sixtieth of the height: the body is some 60 voxels tall.
        assert 56 <= np.ptp(hull.voxels[:, 1]) + 1 <= 62
    save_voxels(voxels, tmp_path / "hull.nc")
    assert load_voxels(tmp_path / "hull.nc").identical(voxels)
    with pytest.raises(InputError, match="no such file"):
        load_voxels(tmp_path / "none.nc")
    walker.to_netcdf(tmp_path / "walk.nc", engine="h5netcdf")
    with pytest.raises(InputError, match="holds no voxels"):
        load_voxels(tmp_path / "walk.nc")


def test_noise_is_that_of_the_seed(walker, six):
    walk = walker.isel(frame=slice(0, 2))
    noise = Noise(flips=0.02, window=3)
    one, same, other = (carve(walk, six, seed=seed, noise=noise) for seed in (1, 1, 2))
    assert one.identical(same)
    assert not one.identical(other)
    assert carve(walk, six, seed=1).identical(carve(walk, six, seed=2))
