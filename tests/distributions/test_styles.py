"""Shapes of style vectors: every one of their densities against draws and integrals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayesmotion.distributions.styles import (
    StyleShape,
    entries_of,
    entry_names,
    later_styles,
    population_styles,
    styles_of,
)

SIZES = [(1, 3), (2, 3), (3, 3), (4, 3), (5, 2), (3, 1)]


@pytest.mark.parametrize(("levels", "size"), SIZES)
def test_a_shape_has_the_vectors_inner_products_but_for_one_length(levels, size):
    styles = np.random.default_rng(0).normal(size=(levels, size))
    Z = np.asarray(styles_of(entries_of(styles), levels, size))
    gram = styles @ styles.T
    np.testing.assert_allclose(Z @ Z.T, gram / gram[0, 0], rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(np.tril(Z), Z)
    assert Z[0, 0] == 1.0
    assert (np.diagonal(Z)[: min(levels, size)] > 0).all() or size == 1
    assert len(entry_names(levels, size)) == StyleShape(levels, size).event_shape[0]


@pytest.mark.parametrize("size", [2, 3])
def test_the_density_of_two_levels_integrates_to_one(size):
    # The entry beside the diagonal has heavy tails: it is spread out as sinh(v).
    v, u = jnp.linspace(-12.0, 12.0, 600), jnp.linspace(-14.0, 12.0, 600)
    grid = jnp.stack(jnp.meshgrid(jnp.sinh(v), u, indexing="ij"), axis=-1).reshape(-1, 2)
    density = jnp.exp(jax.vmap(StyleShape(2, size).log_prob)(grid)).reshape(600, 600)
    mass = jnp.sum(density * jnp.cosh(v)[:, None]) * (v[1] - v[0]) * (u[1] - u[0])
    assert mass == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(("levels", "size"), [(2, 3), (3, 3), (4, 2)])
def test_draws_have_the_density(levels, size):
    """The mean of q(u) / p(u) over draws of p is one for any normalised q."""
    shape = StyleShape(levels, size)
    draws = shape.sample(jax.random.key(1), (40000,))
    centre = jnp.mean(draws, axis=0)
    log_p = jax.vmap(shape.log_prob)(draws)
    log_q = -0.5 * jnp.sum((draws - centre) ** 2 / 0.25 + np.log(2 * np.pi * 0.25), axis=1)
    ratio = np.exp(np.asarray(log_q - log_p))
    error = ratio.std() / np.sqrt(len(ratio))
    assert error < 0.05
    assert abs(ratio.mean() - 1.0) < 4 * error


def test_later_levels_have_the_joint_density_over_that_of_the_known():
    """p(Z of four levels) = p(Z of three) p(fourth | three), when three span the space."""
    known = np.random.default_rng(2).normal(size=(3, 3))
    four = np.concatenate([known, np.random.default_rng(3).normal(size=(1, 3))])
    Z = styles_of(entries_of(four), 4, 3)
    joint = StyleShape(4, 3).log_prob(entries_of(four))
    three = StyleShape(3, 3).log_prob(entries_of(known))
    found = later_styles(Z[:3], 1).log_prob(Z[3:])
    np.testing.assert_allclose(found, joint - three, rtol=1e-9)


def test_new_vectors_of_a_population_lie_about_the_known_ones():
    random = np.random.default_rng(4)
    known = np.array([1.0, 0.2]) + random.normal(size=(400, 2)) @ np.diag([0.1, 0.3])
    padded = np.pad(known, ((0, 0), (0, 1)))
    draws = np.asarray(population_styles(padded, 2, 1).sample(jax.random.key(0), (20_000,)))
    assert draws.shape == (20_000, 2, 3)
    flat = draws.reshape(-1, 3)
    error = flat.std(axis=0) / np.sqrt(len(flat))
    assert (np.abs(flat[:, :2].mean(axis=0) - known.mean(axis=0)) < 4 * error[:2] + 1e-3).all()
    np.testing.assert_allclose(np.cov(flat[:, :2].T), np.cov(known.T), rtol=0.1, atol=2e-3)
    # What only new vectors have is about as large as the rest.
    assert flat[:, 2].std() == pytest.approx(np.sqrt(np.mean([0.1**2, 0.3**2])), rel=0.1)


def test_a_population_is_wide_where_few_are_known():
    one, many = np.array([[1.0, 0.0]]), np.tile([[1.0, 0.0]], (50, 1))
    at = jnp.array([[0.5, 0.4]])
    few, sure = (float(population_styles(known, 1).log_prob(at)) for known in (one, many))
    assert few > sure + 5.0
