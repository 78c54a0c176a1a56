"""Factors, inverses and derivatives block by block against SciPy and finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

from bayesmotion.gp.blocked import factorise, inverse_rows, products, sizes_of
from bayesmotion.gp.kernels import rbf
from bayesmotion.gp.linalg import inverse_factor


def covariance(n):
    root = np.random.default_rng(n).normal(size=(n, n))
    return root @ root.T / n + 0.1 * np.eye(n)


def test_blocks_hold_every_row_once_and_are_of_like_size():
    for n in (1, 40, 164, 165, 399, 6000):
        sizes = sizes_of(n)
        assert sum(sizes) == n
        assert max(sizes) - min(sizes) <= 1
    assert [len(sizes_of(n)) for n in (1, 165, 6000)] == [1, 2, 8]


@pytest.mark.parametrize("n", [1, 230, 399])
def test_factor_and_inverse_are_scipys(n):
    K, Z = covariance(n), np.random.default_rng(0).normal(size=(3, n))

    @jax.jit
    def found(K, Z):
        blocks, H, logdet = factorise(K, Z)
        upper = inverse_rows(blocks)
        return H, logdet, products(upper, upper)

    # The upper triangle is not looked at.
    H, logdet, inverse = found(np.where(np.tri(n) > 0, K, np.nan), Z)
    L = scipy.linalg.cholesky(K, lower=True)
    np.testing.assert_allclose(H, scipy.linalg.solve_triangular(L, Z.T, lower=True).T, rtol=1e-9)
    np.testing.assert_allclose(logdet, np.linalg.slogdet(K)[1], rtol=1e-12)
    np.testing.assert_allclose(inverse, scipy.linalg.inv(K), atol=1e-11 * np.abs(inverse).max())
    np.testing.assert_allclose(inverse, inverse.T, atol=1e-14 * np.abs(inverse).max())


def test_the_nugget_is_added_to_the_diagonal():
    K, Z = covariance(5), np.ones((1, 5))
    for one, other in zip(factorise(K, Z, 0.3)[1:], factorise(K + 0.3 * np.eye(5), Z)[1:],
                          strict=True):  # fmt: skip
        np.testing.assert_allclose(one, other, rtol=1e-13)


def test_a_matrix_that_is_not_positive_definite_has_no_determinant():
    K = covariance(230)
    K[200, 200] = -1.0
    assert np.isnan(factorise(K, np.ones((1, 230)))[2])


def test_the_inverse_of_a_triangle_is_scipys():
    L = scipy.linalg.cholesky(covariance(131), lower=True)
    true = scipy.linalg.solve_triangular(L, np.eye(131), lower=True)
    np.testing.assert_allclose(inverse_factor(L), true, atol=1e-13 * np.abs(true).max())


def test_derivatives_of_the_rbf_by_hand_are_those_of_its_formula():
    random = np.random.default_rng(1)
    A, B, on_K = (random.normal(size=shape) for shape in ((7, 3), (5, 3), (7, 5)))

    def by_hand(A, B, length):
        K = rbf("x", length_scale=length, variance=2.0).matrix({"x": A}, {"x": B})
        return jnp.sum(on_K * K)

    def formula(A, B, length):
        squared = jnp.sum((A[:, None] - B[None]) ** 2, axis=-1)
        return jnp.sum(on_K * 2.0 * jnp.exp(-0.5 * squared / length**2))

    at = (jnp.asarray(A), jnp.asarray(B), jnp.array(0.8))
    for one, true in zip(*(jax.grad(f, (0, 1, 2))(*at) for f in (by_hand, formula)), strict=True):
        np.testing.assert_allclose(one, true, rtol=1e-11)
    second = [jax.grad(lambda r, f=f: jax.grad(f, 2)(*at[:2], r))(at[2])
              for f in (by_hand, formula)]  # fmt: skip
    np.testing.assert_allclose(*second, rtol=1e-11)
