"""k-means on clusters that are known."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.models.clusters import (
    find_clusters,
    nearest_centre,
    seed_centres,
    squared_distances,
)

CENTRES = np.array([[0.0, 0.0, 5.0], [4.0, 0.0, 0.0], [0.0, -6.0, 0.0], [9.0, 9.0, 9.0]])


@pytest.fixture(scope="module")
def points():
    random = np.random.default_rng(1)
    return (CENTRES[:, None] + 0.2 * random.standard_normal((4, 60, 3))).reshape(-1, 3)


def test_clusters_are_found(points):
    clusters = find_clusters(points, 4, seed=0)
    order = nearest_centre(CENTRES, clusters.centre)
    assert sorted(order) == [0, 1, 2, 3]
    np.testing.assert_allclose(clusters.centre[order], CENTRES, atol=0.15)
    own = points - clusters.centre[nearest_centre(points, clusters.centre)]
    assert clusters.spread == pytest.approx(np.sqrt((own**2).sum(axis=1).mean()))


def test_updates_never_make_it_worse(points):
    spreads = [find_clusters(points, 7, seed=3, steps=steps).spread for steps in range(5)]
    assert spreads == sorted(spreads, reverse=True)
    assert spreads[0] > spreads[4]


def test_seeds_are_different_points_far_apart(points):
    seeds = [seed_centres(points, 4, seed) for seed in range(20)]
    hit = [len(set(nearest_centre(s, CENTRES))) for s in seeds]
    # Four points drawn evenly hit all four clusters in 4! / 4^4 = 9 % of cases.
    assert np.mean(np.array(hit) == 4) > 0.9
    assert len(np.unique(seed_centres(points[:5], 5, 0), axis=0)) == 5
    with pytest.raises(InputError, match="fewer than 3 different"):
        seed_centres(np.repeat(points[:2], 5, axis=0), 3, 0)


def test_distances_are_those_of_the_definition(points):
    away = ((points[:, None] - CENTRES) ** 2).sum(axis=2)
    np.testing.assert_allclose(squared_distances(points, CENTRES), away, rtol=1e-10)


def test_votes_go_to_the_nearest(points):
    clusters = find_clusters(points, 4, seed=0)
    votes = clusters.votes(points[:10], near=2)
    np.testing.assert_allclose(votes.sum(axis=1), 1.0)
    assert ((votes > 0).sum(axis=1) <= 2).all()
    np.testing.assert_array_equal(
        votes.argmax(axis=1), nearest_centre(points[:10], clusters.centre)
    )
    hard = clusters.votes(points[:10], near=1)
    np.testing.assert_array_equal(np.sort(hard, axis=1)[:, -1], 1.0)
    away = squared_distances(points[:1], clusters.centre)[0]
    share = np.exp(-away / 2 / clusters.spread**2)
    np.testing.assert_allclose(clusters.votes(points[:1], near=9)[0], share / share.sum())
