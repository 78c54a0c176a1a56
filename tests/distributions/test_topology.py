"""Surfaces, their order and neighbours, and the density around them, by other ways."""

from itertools import permutations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bayesmotion.distributions.topology import (
    LocallyLinear,
    Surface,
    length_of,
    lle_weights,
    log_normaliser,
    open_path,
    topology_of,
    tour,
)
from bayesmotion.errors import InputError

TORUS = Surface("torus", 12, 6, (0.4, 1.0, 1.25))
CYLINDER = Surface("cylinder", 12, 6, (0.4, 1.0, 1.25))


def test_the_torus_is_equation_six():
    t = TORUS.points().reshape(3, 6, 12, 3)
    R = TORUS.major
    for s, g, p in ((0, 0, 0), (1, 2, 5), (2, 5, 11)):
        a, b, r = 2 * np.pi * p / 12, 2 * np.pi * g / 6, TORUS.radii[s]
        out = R + r * np.cos(a)
        np.testing.assert_allclose(
            t[s, g, p], [out * np.cos(b), out * np.sin(b), r * np.sin(a)], atol=1e-12
        )
    # Every point is its layer's radius from the circle in the middle.
    ring = np.linalg.norm(t[..., :2], axis=-1) - R
    away = np.hypot(ring, t[..., 2])
    np.testing.assert_allclose(away, np.array(TORUS.radii)[:, None, None] * np.ones((3, 6, 12)))


def test_the_cylinder_is_equation_seven():
    t = CYLINDER.points().reshape(3, 6, 12, 3)
    np.testing.assert_allclose(np.diff(t[1, :, 0, 1]), 0.5)
    a = 2 * np.pi * 4 / 12
    np.testing.assert_allclose(t[2, 3, 4, [0, 2]], [1.25 * np.cos(a), 1.25 * np.sin(a)])


def test_layers_that_do_not_grow_are_refused():
    for radii in ((), (1.0, 0.5), (-1.0, 1.0), (1.0, 1.0)):
        with pytest.raises(InputError, match="do not grow"):
            Surface("torus", 8, 4, radii)
    with pytest.raises(InputError, match="neighbours within"):
        topology_of(Surface("torus", 3, 3))


@pytest.mark.parametrize("closed", [True, False])
def test_orders_are_the_shortest_of_all(closed):
    random = np.random.default_rng(4)
    for _ in range(3):
        places = random.normal(size=(7, 2))
        distance = np.linalg.norm(places[:, None] - places[None], axis=-1)
        found = tour(distance) if closed else open_path(distance)
        assert sorted(found) == list(range(7))
        best = min(length_of(distance, list(p), closed=closed) for p in permutations(range(7)))
        assert length_of(distance, found, closed=closed) == pytest.approx(best, rel=1e-4)


def test_neighbours_are_where_the_structure_says():
    topology, index = topology_of(TORUS), TORUS.index()
    assert topology.neighbours.shape == (216, 16)
    for i, row in enumerate(topology.neighbours):
        assert i not in row
        assert len(set(row.tolist())) == 16
        layers = np.bincount(index[row, 0], minlength=3).tolist()
        assert layers == {0: [10, 6, 0], 1: [3, 10, 3], 2: [0, 6, 10]}[index[i, 0]]
        poses = (index[row, 2] - index[i, 2] + 6) % 12 - 6
        gaits = (index[row, 1] - index[i, 1] + 3) % 6 - 3
        assert np.abs(poses).max() <= 2
        assert np.abs(gaits).max() <= 1
    # The cylinder does not close: gaits at its ends have neighbours on one side only.
    ends = topology_of(CYLINDER).neighbours[CYLINDER.index()[:, 1] == 0]
    assert CYLINDER.index()[ends, 1].max() <= 2


def test_a_pose_of_the_circle_knows_its_own_cycle_alone():
    surface = Surface("circle", 12, 3)
    topology = topology_of(surface)
    gait = surface.index()[:, 1]
    np.testing.assert_array_equal(gait[topology.neighbours], np.repeat(gait[:, None], 10, 1))
    np.testing.assert_array_equal(topology.constrained, [1, 0, 1])


@pytest.mark.parametrize("surface", [TORUS, CYLINDER])
def test_weights_make_the_surface_of_itself(surface):
    topology, t = topology_of(surface), surface.points()
    np.testing.assert_allclose(topology.weights.sum(axis=-1), 1.0)
    energy = float(jnp.sum(topology.residual(t) ** 2))
    shuffled = np.random.default_rng(0).permutation(t)
    assert energy < 1e-3 < 100 * energy + 100 < float(jnp.sum(topology.residual(shuffled) ** 2))


def test_weights_solve_equation_nine():
    random = np.random.default_rng(1)
    t, neighbours = (
        random.normal(size=(4, 1)),
        np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]),
    )
    w = lle_weights(t, neighbours)[0, 0]
    apart = t[0, 0] - t[[1, 2, 3], 0]
    C = np.outer(apart, apart)
    C = C + 1e-3 * np.trace(C) * np.eye(3)
    by_hand = np.linalg.inv(C).sum(axis=1)
    np.testing.assert_allclose(w, by_hand / by_hand.sum(), rtol=1e-9)


@pytest.fixture(scope="module")
def around():
    surface = Surface("torus", 8, 4, (0.5, 1.0))
    topology = topology_of(surface)
    return surface, topology, LocallyLinear(
        topology, 0.3, 2.0, log_normaliser(topology, 0.3, 2.0)
    )  # fmt: skip


def covariance(topology, axis: int) -> np.ndarray:
    n = len(topology.neighbours)
    W = np.zeros((n, n))
    for i, row in enumerate(topology.neighbours):
        for j, w in zip(row, topology.weights[axis, i], strict=True):
            W[i, j] += w
    rest = np.eye(n) - W
    return np.linalg.inv(2.0 * rest.T @ rest / 0.3**2 + np.eye(n) / 2.0**2)


def test_the_density_is_a_normal_one_with_its_constant(around):
    surface, topology, prior = around
    x = surface.points() + 0.1 * np.random.default_rng(2).normal(size=(surface.size, 3))
    expected = sum(
        multivariate_normal(np.zeros(surface.size), covariance(topology, q)).logpdf(x[:, q])
        for q in range(3)
    )
    np.testing.assert_allclose(float(prior.log_prob(x)), expected, rtol=1e-8)


def test_draws_have_that_covariance(around):
    surface, topology, prior = around
    draws = np.asarray(prior.sample(jax.random.key(0), (4000,)))
    assert draws.shape == (4000, surface.size, 3)
    for q in range(3):
        C = covariance(topology, q)
        for i, j in ((0, 0), (0, 1), (5, 40)):
            product = draws[:, i, q] * draws[:, j, q]
            error = product.std() / np.sqrt(len(draws))
            assert abs(product.mean() - C[i, j]) < 4.5 * error
