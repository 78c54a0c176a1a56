"""Vectors by length and direction: there and back, and the volume in between."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayesmotion.distributions.polar import log_volume, polar_of, vectors_of


@pytest.mark.parametrize("size", [2, 3, 5])
@pytest.mark.parametrize("towards", [1.0, -1.0])
def test_there_and_back_and_the_volume_element(size, towards):
    random = np.random.default_rng(size)
    centre = random.normal(size=size) * towards
    vectors = random.normal(size=(4, size))
    polar = polar_of(vectors, centre)
    np.testing.assert_allclose(vectors_of(polar, centre), vectors, rtol=1e-10)
    one = jax.jacobian(lambda p: vectors_of(p.reshape(4, size), centre).ravel())(polar.ravel())
    brute = np.linalg.slogdet(np.asarray(one))[1]
    np.testing.assert_allclose(log_volume(polar), brute, rtol=1e-9)


@pytest.mark.parametrize("spare", [1, 2])
def test_spare_axes_have_a_length_of_their_own(spare):
    random = np.random.default_rng(spare)
    centre = np.array([0.4, -1.0, 0.2, *np.zeros(spare)])
    vectors = random.normal(size=(2, 3 + spare))
    vectors[:, 3:] = np.abs(vectors[:, 3:])
    polar = polar_of(vectors, centre, spare)
    np.testing.assert_allclose(vectors_of(polar, centre, spare), vectors, rtol=1e-10)
    np.testing.assert_allclose(polar[:, 3], np.log(np.linalg.norm(vectors[:, 3:], axis=1)))
    shape = polar.shape
    one = jax.jacobian(lambda p: vectors_of(p.reshape(shape), centre, spare).ravel())(polar.ravel())
    brute = np.linalg.slogdet(np.asarray(one))[1]
    np.testing.assert_allclose(log_volume(polar, spare), brute, rtol=1e-9)


def test_directions_count_from_the_centre():
    centre = np.array([0.3, -2.0, 0.5])
    across = np.cross(centre, [1.0, 0.0, 0.0])
    polar = np.asarray(polar_of(np.stack([3.0 * centre, across]), centre))
    np.testing.assert_allclose(polar[0, 1:], 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(polar[1, 1:]), 1.0, rtol=1e-10)
    np.testing.assert_allclose(polar[:, 0], np.log(np.linalg.norm([3 * centre, across], axis=1)))


def test_a_constant_product_of_lengths_is_a_straight_line():
    s, g, centre = np.array([[1.0, 2.0, 0.0]]), np.array([[0.5, 0.0, 1.0]]), np.ones(3)
    stretch = jnp.linspace(0.2, 5.0, 7)
    line = np.stack(
        [np.concatenate([polar_of(c * s, centre)[0], polar_of(g / c, centre)[0]]) for c in stretch]
    )
    np.testing.assert_allclose(line[:, 0] + line[:, 3], line[0, 0] + line[0, 3], rtol=1e-12)
    np.testing.assert_allclose(np.delete(line, [0, 3], axis=1), line[:1, [1, 2, 4, 5]].repeat(7, 0))
