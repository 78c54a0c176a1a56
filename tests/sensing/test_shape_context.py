"""Shape contexts against the definition, one voxel and one bin at a time."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.motion import skeleton_of
from bayesmotion.sensing.voxels.body import Ellipsoids, body_of, pose_body
from bayesmotion.sensing.voxels.cameras import circle
from bayesmotion.sensing.voxels.carving import carve, hulls
from bayesmotion.sensing.voxels.hull import Region, basis, surface, visual_hull
from bayesmotion.sensing.voxels.shape_context import ShapeContext
from bayesmotion.sensing.voxels.silhouettes import silhouettes

SMALL = ShapeContext(radial=2, elevation=3, azimuth=4, reach=0.15)


def tent(place: float, middle: int, count: int, wraps: bool) -> float:
    """The share of a vote at `place` (in bins) that the bin `middle` gets."""
    if wraps and count == 1:
        return 1.0
    if wraps:
        away = abs((place - (middle + 0.5) + count / 2) % count - count / 2)
        return max(0.0, 1.0 - away)
    place = min(max(place, 0.5), count - 0.5)  # the outermost half bins take it whole
    return max(0.0, 1.0 - abs(place - (middle + 0.5)))


def by_hand(context: ShapeContext, voxels: np.ndarray, middle: np.ndarray) -> np.ndarray:
    out = np.zeros((context.radial, context.elevation, context.azimuth))
    low, high = 2.0, context.reach * 60
    for x, y, z in voxels - middle:
        r = np.sqrt(x * x + y * y + z * z)
        if not low <= r < high:
            continue
        places = (
            context.radial * np.log(r / low) / np.log(high / low),
            context.elevation * np.arccos(y / r) / np.pi,
            context.azimuth * np.arctan2(x, z) / (2 * np.pi),
        )
        for i, j, k in np.ndindex(out.shape):
            inner, outer = (low * (high / low) ** (n / context.radial) for n in (i, i + 1))
            edges = [np.cos(np.pi * n / context.elevation) for n in (j, j + 1)]
            volume = (outer**3 - inner**3) / 3 * (edges[0] - edges[1]) * 2 * np.pi
            volume /= context.azimuth
            share = tent(places[0], i, context.radial, False)
            share *= tent(places[1], j, context.elevation, False)
            share *= tent(places[2], k, context.azimuth, True)
            out[i, j, k] += share / volume ** (1 / 3)
    return out.ravel()


@pytest.fixture
def cloud():
    return np.unique(np.random.default_rng(4).integers(-12, 12, size=(150, 3)), axis=0)


@pytest.mark.parametrize("context", [SMALL, ShapeContext(3, 1, 1, reach=0.1)])
def test_descriptors_are_those_of_the_definition(cloud, context):
    found = context.describe(cloud, cloud[::40])
    assert found.shape == (len(cloud[::40]), context.bins)
    wanted = np.array([by_hand(context, cloud, middle) for middle in cloud[::40]])
    assert (wanted > 0).mean() > 0.5
    np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-5)


def test_votes_are_whole():
    """What a voxel gives to all bins together, without the weights, is one."""
    offsets = np.array([[3, 0, 0], [0, 5, 0], [0, -4, 0], [2, 3, -1], [0, 1, 0], [9, 0, 0]])
    unweighted = SMALL.votes(offsets).multiply(np.cbrt(SMALL.volumes.ravel()))
    np.testing.assert_allclose(unweighted.sum(axis=1), [1, 1, 1, 1, 0, 0])


def test_bins_fill_the_ball():
    context = ShapeContext()
    shell = 4 / 3 * np.pi * (context.outer**3 - context.inner**3)
    assert context.volumes.sum() == pytest.approx(shell)
    assert context.bins == 200
    assert context.outer == pytest.approx(20.0)


def test_moving_the_subject_changes_nothing_and_turning_does(cloud):
    context = ShapeContext()
    by = np.array([40, -3, 7])
    there = context.describe(cloud + by, cloud[:5] + by)
    here = context.describe(cloud, cloud[:5])
    np.testing.assert_array_equal(there, here)
    quarter = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    turned = context.describe(cloud @ quarter.T, cloud[:5] @ quarter.T)
    assert np.abs(turned - here).max() > 0.5
    # A quarter of a turn is a whole number of bins where there are four or eight of them.
    even = ShapeContext(azimuth=8)
    before = even.describe(cloud, cloud[:5]).reshape(5, -1, 8)
    after = even.describe(cloud @ quarter.T, cloud[:5] @ quarter.T).reshape(5, -1, 8)
    np.testing.assert_allclose(after, np.roll(before, 2, axis=2), atol=1e-4)


def test_a_larger_subject_is_described_alike(walker, six):
    """Twice the subject, twice the distances: the same voxels, so the same descriptors."""
    body = pose_body(body_of(skeleton_of(walker)), walker)
    giant = Ellipsoids(2 * body.centre, 4 * body.shape)
    cameras = circle(6, radius=12.0, height=3.2, target=(0.0, 2.0, 0.0))
    region = Region((-1.0, -0.2, -1.0), (1.0, 2.1, 1.0))
    twice = Region((-2.0, -0.4, -2.0), (2.0, 4.2, 2.0))
    one = visual_hull(silhouettes(body, 0, six), six, 1.7 / 60, region)
    other = visual_hull(silhouettes(giant, 0, cameras), cameras, 3.4 / 60, twice)
    found = [ShapeContext().describe(v[surface(v)], basis(v[surface(v)])) for v in (one, other)]
    np.testing.assert_allclose(found[0], found[1], atol=1e-5)


def test_every_setting_changes_something(cloud):
    plain = ShapeContext()
    seen = plain.describe(cloud, cloud[:3])
    for change in ({"reach": 0.2}, {"inner": 3.0}):
        assert not np.allclose(ShapeContext(**change).describe(cloud, cloud[:3]), seen)
    for change in ({"radial": 3}, {"elevation": 4}, {"azimuth": 8}):
        assert ShapeContext(**change).describe(cloud, cloud[:3]).shape[1] != seen.shape[1]
    for bad in ({"radial": 0}, {"reach": 0.01}, {"inner": 0.0}, {"reach": 3.0}):
        with pytest.raises(InputError, match="shape context"):
            ShapeContext(**bad)


def test_real_hulls_have_some_two_hundred_basis_voxels(walker, six):
    for hull in hulls(carve(walker.isel(frame=slice(0, 2)), six, seed=0)):
        assert 150 < len(basis(hull.shell)) < 320
