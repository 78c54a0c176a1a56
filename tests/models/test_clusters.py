"""k-means on clusters that are known."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.models.clusters import find_clusters, nearest_centre

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
    assert clusters.sd == pytest.approx(np.sqrt((own**2).sum(axis=1).mean()))


def test_updates_never_make_it_worse(points):
    found = [find_clusters(points, 7, seed=3, steps=steps).sd for steps in range(1, 6)]
    assert found == sorted(found, reverse=True)


def test_too_few_different_points_are_refused(points):
    assert len(np.unique(find_clusters(points[:5], 5, seed=0).centre, axis=0)) == 5
    with pytest.raises(InputError, match="fewer than 3 different"):
        find_clusters(np.repeat(points[:2], 5, axis=0), 3, seed=0)
    with pytest.raises(InputError, match="fewer than 3 different"):
        find_clusters(points[:2], 3, seed=0)


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
    away = ((points[0] - clusters.centre) ** 2).sum(axis=1)
    share = np.exp(-away / 2 / clusters.sd**2)
    np.testing.assert_allclose(clusters.votes(points[:1], near=9)[0], share / share.sum())
