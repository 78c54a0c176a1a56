"""Kernels against their textbook formulas, entry by entry."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.gp.kernels import (
    bias,
    linear,
    matern,
    periodic,
    rational_quadratic,
    rbf,
    white,
)

W = np.random.default_rng(0).normal(size=(5, 4))


def distance(a, b):
    return math.sqrt(sum((i - j) ** 2 for i, j in zip(a, b, strict=True)))


def matern_formula(smoothness):
    """Rasmussen and Williams (2006), eq. 4.17, from the general half-integer form 4.16."""

    def k(a, b):
        p = int(smoothness - 0.5)
        r = distance(a["x"], b["x"]) / 0.8
        x = math.sqrt(8.0 * smoothness) * r
        terms = (
            math.factorial(p + i) / (math.factorial(i) * math.factorial(p - i)) * x ** (p - i)
            for i in range(p + 1)
        )
        return 1.3 * math.exp(-x / 2) * math.factorial(p) / math.factorial(2 * p) * sum(terms)

    return k


def periodic_formula(a, b):
    sines = (math.sin(math.pi * (i - j) / 1.4) ** 2 for i, j in zip(a["x"], b["x"], strict=True))
    return 1.3 * math.exp(-2.0 * sum(sines) / 0.8**2)


def rbf_formula(a, b):
    return 1.3 * math.exp(-(distance(a["x"], b["x"]) ** 2) / (2 * 0.8**2))


def linear_formula(a, b):
    return 0.7 * sum(i * j for i, j in zip(a["s"], b["s"], strict=True))


SMOOTH = {
    "linear": (linear("s", variance=0.7), linear_formula),
    "rbf": (rbf("x", length_scale=0.8, variance=1.3), rbf_formula),
    "rational quadratic": (
        rational_quadratic("x", length_scale=0.8, mixture=1.7, variance=1.3),
        lambda a, b: 1.3 * (1 + distance(a["x"], b["x"]) ** 2 / (2 * 1.7 * 0.8**2)) ** -1.7,
    ),
    "matern 1/2": (matern("x", 0.5, length_scale=0.8, variance=1.3), matern_formula(0.5)),
    "matern 3/2": (matern("x", 1.5, length_scale=0.8, variance=1.3), matern_formula(1.5)),
    "matern 5/2": (matern("x", 2.5, length_scale=0.8, variance=1.3), matern_formula(2.5)),
    "periodic": (periodic("x", period=1.4, length_scale=0.8, variance=1.3), periodic_formula),
    "bias": (bias(0.9), lambda a, b: 0.9),
    "sum": (
        linear("s", variance=0.7) + rbf("x", length_scale=0.8, variance=1.3) + bias(0.9),
        lambda a, b: linear_formula(a, b) + rbf_formula(a, b) + 0.9,
    ),
    "product of three factors": (
        linear("s", variance=0.7)
        * linear("g", variance=2.0)
        * rbf("x", length_scale=0.8, variance=1.3),
        lambda a, b: linear_formula(a, b) * 2.0 * float(a["g"] @ b["g"]) * rbf_formula(a, b),
    ),
    "sum of products": (
        (linear("s", variance=0.7) + bias(0.9)) * rbf("x", length_scale=0.8, variance=1.3),
        lambda a, b: (linear_formula(a, b) + 0.9) * rbf_formula(a, b),
    ),
}
ALL = {
    **SMOOTH,
    "white": (white("frame", 0.6), lambda a, b: 0.6 * float(a["frame"][0] == b["frame"][0])),
}


def points(n: int, seed: int) -> dict[str, np.ndarray]:
    """Points whose second row repeats the first, and with rows all sets share."""
    random = np.random.default_rng(seed)
    out = {"s": random.normal(size=(n, 3)), "g": random.normal(size=(n, 1))}
    out |= {"x": random.normal(size=(n, 2)), "frame": np.arange(n)[:, None] // 2 * 1.0}
    for name in ("s", "g", "x"):
        out[name][0] = 0.5
        out[name][1] = out[name][0]
    return out


@pytest.mark.parametrize("name", ALL)
def test_every_entry_is_the_textbooks(name: str):
    kernel, formula = ALL[name]
    a, b = points(5, 1), points(4, 2)
    expected = [
        [
            formula({k: v[i] for k, v in a.items()}, {k: v[j] for k, v in b.items()})
            for j in range(4)
        ]
        for i in range(5)
    ]
    np.testing.assert_allclose(kernel.matrix(a, b), expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("name", ALL)
def test_covariances_are_symmetric_and_positive_semidefinite(name: str):
    K = np.asarray(ALL[name][0].matrix(points(12, 3), points(12, 3)))
    np.testing.assert_allclose(K, K.T, rtol=1e-13, atol=1e-15)
    assert np.linalg.eigvalsh(K).min() > -1e-12 * np.trace(K)
    assert np.trace(K) > 0


@pytest.mark.parametrize("name", SMOOTH)
def test_gradients_equal_finite_differences_also_where_points_coincide(name: str):
    kernel = SMOOTH[name][0]
    a, b = points(5, 1), points(4, 2)

    def total(k, rows, columns):
        return jnp.sum(W * k.matrix(rows, columns))

    found = jax.tree.leaves(jax.jit(jax.grad(total, argnums=(0, 1, 2)))(kernel, a, b))
    leaves, structure = jax.tree.flatten((kernel, a, b))
    total = jax.jit(total)
    for place, leaf in enumerate(map(np.asarray, leaves)):
        expected = np.zeros(leaf.shape)
        for entry in np.ndindex(leaf.shape):
            # The Matern 1/2 kernel has a kink where points coincide; the two sides cancel.
            h = np.zeros(leaf.shape)
            h[entry] = 1e-5
            ends = [
                float(
                    total(*structure.unflatten([*leaves[:place], leaf + s, *leaves[place + 1 :]]))
                )
                for s in (h, -h)
            ]
            expected[entry] = (ends[0] - ends[1]) / 2e-5
        np.testing.assert_allclose(found[place], expected, atol=2e-8, rtol=1e-6)


def test_gradients_are_finite_when_all_points_are_one():
    same = {"x": jnp.ones((3, 2)), "s": jnp.ones((3, 3)), "g": jnp.ones((3, 1))}

    @jax.jit
    @jax.grad
    def slopes(p):
        return sum(jnp.sum(kernel.matrix(p, p)) for kernel, _ in SMOOTH.values())

    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slopes(same)))


def test_parameters_are_traced_and_factor_names_are_not():
    a, b = points(5, 1), points(4, 2)
    kernel = SMOOTH["product of three factors"][0]
    assert len(jax.tree.leaves(kernel)) == 4
    assert jax.tree.map(lambda leaf: leaf, kernel) == kernel
    plain = kernel.matrix(a, b)
    np.testing.assert_allclose(jax.jit(lambda k: k.matrix(a, b))(kernel), plain, rtol=1e-14)
    scales = jnp.array([0.5, 0.8, 2.0])
    batch = jax.vmap(lambda scale: rbf("x", length_scale=scale))(scales)
    many = jax.vmap(lambda k: k.matrix(a, b))(batch)
    for scale, one in zip(scales, many, strict=True):
        np.testing.assert_allclose(one, rbf("x", length_scale=scale).matrix(a, b), rtol=1e-14)


def test_a_constant_factor_leaves_the_plain_kernel():
    a, b = points(5, 1), points(4, 2)
    for p in (a, b):
        p["s"] = np.tile([0.6, 0.0, 0.8], (len(p["x"]), 1))
        p["g"] = np.tile([1.0], (len(p["x"]), 1))
    product = linear("s") * linear("g") * rbf("x", length_scale=0.8)
    np.testing.assert_allclose(
        product.matrix(a, b), rbf("x", length_scale=0.8).matrix(a, b), rtol=1e-14
    )


def test_white_tells_measurements_apart_by_number():
    numbered = {"frame": np.arange(4)[:, None]}  # whole numbers, as frames have
    np.testing.assert_array_equal(white("frame", 0.5).matrix(numbered, numbered), 0.5 * np.eye(4))


def test_what_a_kernel_cannot_use_is_told():
    a = points(3, 1)
    k = linear("style") * rbf("x")
    with pytest.raises(InputError, match=r"kernel: .*'style', the points have \['frame', 'g'"):
        k.matrix(a, a)
    with pytest.raises(InputError, match="'style'"):
        k.matrix(a | {"style": a["s"]}, a)
    with pytest.raises(InputError, match=r"factor 'x' has shape \(3,\)"):
        rbf("x").matrix({"x": np.arange(3.0)}, a)
    with pytest.raises(InputError, match=r"matern: the smoothness is 2"):
        matern("x", 2.0)
    with pytest.raises(InputError, match="the points have no factors"):
        bias(1.0).matrix({}, {})
