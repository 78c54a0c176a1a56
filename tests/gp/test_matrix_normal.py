"""The matrix-normal density against brute force on small problems, whatever is missing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bayesmotion.errors import NumericalError
from bayesmotion.gp.linalg import cholesky, inverse_factor, require_finite
from bayesmotion.gp.matrix_normal import (
    GaussianProcess,
    complete,
    condition,
    log_density,
    masked,
    patterns,
    quadratic_logdet,
    smooth,
)

N, D, M = 6, 4, 5
SCALE = np.array([0.5, 1.0, 2.0, 3.0])


def covariance(n: int, seed: int, noise: float = 0.3) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(n, n))
    return root @ root.T / n + noise * np.eye(n)


def some_missing(kind: str) -> np.ndarray:
    """(N, D) which entries are seen; in every column other ones, unless nothing is missing."""
    if kind == "nothing missing":
        return np.ones((N, D), bool)
    random = np.random.default_rng(len(kind))
    while True:
        seen = random.uniform(size=(N, D)) < 0.6
        if kind == "a column missing":
            seen[:, 2] = False
        if kind == "a row missing":
            seen[3] = False
        # The same number of patterns each time, so that there is one compilation.
        if len(np.unique(seen, axis=1).T) == D:
            return seen


KINDS = (
    "nothing missing",
    "some missing",
    "other entries missing",
    "a column missing",
    "a row missing",
)
density = jax.jit(log_density)
slopes_of = jax.jit(jax.grad(log_density, argnums=(0, 1, 2)))


@pytest.fixture(scope="module", params=KINDS)
def seen(request) -> np.ndarray:
    return some_missing(request.param)


def brute_force(residual, K, scale, seen) -> float:
    total = 0.0
    for d in range(residual.shape[1]):
        rows = seen[:, d]
        if rows.any():
            own = K[np.ix_(rows, rows)] / scale[d] ** 2
            total += multivariate_normal(np.zeros(rows.sum()), own).logpdf(residual[rows, d])
    return total


def naive(residual, K, scale, seen):
    """The same in JAX, entry by entry, differentiated by JAX."""
    total = 0.0
    for d in range(residual.shape[1]):
        rows = np.flatnonzero(seen[:, d])
        own = K[jnp.ix_(rows, rows)] / scale[d] ** 2
        r = residual[rows, d]
        total -= 0.5 * (r @ jnp.linalg.solve(own, r) + jnp.linalg.slogdet(2 * jnp.pi * own)[1])
    return total


def test_density_is_the_marginal_over_the_entries_seen(seen):
    residual = np.random.default_rng(1).normal(size=(N, D))
    K = covariance(N, 2)
    expected = brute_force(residual, K, SCALE, seen)
    missing = patterns(seen)
    np.testing.assert_allclose(density(residual, K, SCALE, missing), expected, rtol=1e-8)
    # What stands in the place of an entry not seen makes no difference.
    for filling in (0.0, 1e3, np.nan):
        filled = np.where(seen, residual, filling)
        np.testing.assert_allclose(density(filled, K, SCALE, missing), expected, rtol=1e-8)


def test_patterns_share_a_factorisation_among_columns_alike():
    seen = np.ones((N, D), bool)
    seen[4:, [1, 3]] = False
    missing = patterns(seen)
    assert missing.rows.shape == (2, N)
    np.testing.assert_array_equal(missing.columns.sum(axis=0), 1.0)
    np.testing.assert_array_equal(missing.rows.T @ missing.columns, seen)
    np.testing.assert_array_equal(missing.which, 0)
    whole = patterns(np.ones((N, D), bool))
    for one, other in zip(whole, complete(N, D), strict=True):
        np.testing.assert_array_equal(one, other)


def test_gradients_are_finite_differences(seen):
    random = np.random.default_rng(3)
    arguments = (random.normal(size=(N, D)), covariance(N, 4), SCALE)
    found = slopes_of(*arguments, patterns(seen))
    for place in range(3):
        way = random.normal(size=arguments[place].shape)
        if place == 1:
            way = way + way.T
        ends = []
        for h in (1e-5, -1e-5):
            moved = list(arguments)
            moved[place] = moved[place] + h * way
            ends.append(brute_force(*moved, seen))
        slope = np.sum(np.asarray(found[place]) * way)
        np.testing.assert_allclose(slope, (ends[0] - ends[1]) / 2e-5, rtol=1e-6, atol=1e-7)


def test_gradients_are_those_of_the_naive_density():
    seen = some_missing("a column missing")
    arguments = (np.random.default_rng(3).normal(size=(N, D)), covariance(N, 4), SCALE)
    expected = jax.jit(jax.grad(lambda *a: naive(*a, seen), argnums=(0, 1, 2)))(*arguments)
    for one, other in zip(slopes_of(*arguments, patterns(seen)), expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-8)


def test_gradients_stay_finite_where_entries_not_seen_are_nan():
    seen = some_missing("some missing")
    residual = np.where(seen, np.random.default_rng(1).normal(size=(N, D)), np.nan)
    slopes = slopes_of(residual, covariance(N, 4), SCALE, patterns(seen))
    assert all(np.isfinite(slope).all() for slope in slopes)
    np.testing.assert_array_equal(np.asarray(slopes[0])[~seen], 0.0)


def test_quadratic_forms_and_determinant_each_have_their_gradient():
    random = np.random.default_rng(5)
    K, Z, weight = covariance(N, 6), random.normal(size=(N, D)), random.normal(size=D)

    def ours(K, Z):
        quadratic, logdet = quadratic_logdet(K, Z)
        return weight @ quadratic - 0.7 * logdet**2

    def plain(K, Z):
        quadratic = jnp.sum(Z * jnp.linalg.solve(K, Z), axis=0)
        return weight @ quadratic - 0.7 * jnp.linalg.slogdet(K)[1] ** 2

    found, expected = (jax.jit(jax.value_and_grad(f, argnums=(0, 1)))(K, Z) for f in (ours, plain))
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-8)
    for one, other in zip(found[1], expected[1], strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-8)


def test_density_and_gradient_may_be_vectorised_and_compiled():
    seen = some_missing("some missing")
    residual = np.random.default_rng(1).normal(size=(N, D))
    Ks = np.stack([covariance(N, seed) for seed in range(3)])
    scales = np.stack([SCALE, 2.0 * SCALE, SCALE[::-1]])

    def both(K, scale):
        return jax.value_and_grad(log_density, argnums=1)(residual, K, scale, patterns(seen))

    values, slopes = jax.jit(jax.vmap(both))(Ks, scales)
    for K, scale, value, slope in zip(Ks, scales, values, slopes, strict=True):
        np.testing.assert_allclose(value, brute_force(residual, K, scale, seen), rtol=1e-8)
        alone = slopes_of(residual, K, scale, patterns(seen))[1]
        np.testing.assert_allclose(slope, alone, rtol=1e-10, atol=1e-12)


def conditional(joint, old, y):
    """Mean and covariance of the rest of a Gaussian given its entries `old`."""
    new = ~old
    gain = np.linalg.solve(joint[np.ix_(old, old)], joint[np.ix_(old, new)]).T
    rest = joint[np.ix_(new, new)] - gain @ joint[np.ix_(old, new)]
    return gain @ y, rest


@pytest.fixture(scope="module", params=("nothing missing", "a column missing"))
def two_sets(request):
    """Training and new data of one process, of the new ones always something missing."""
    random = np.random.default_rng(7)
    prior = covariance(N + M, 8, noise=0.05)
    old, new = some_missing(request.param), random.uniform(size=(M, D)) < 0.5
    if request.param == "a column missing":
        new[:, 0] = False
        new[2] = False
    return prior, random.normal(size=(N + M, D)), old, new


NOISE = 0.2


def test_conditioning_is_the_joint_gaussians(two_sets):
    prior, y, old, _ = two_sets
    missing = patterns(old)
    known = condition(y[:N], prior[:N, :N] + NOISE * np.eye(N), missing)
    mean, covariances = known(prior[N:, :N], prior[N:, N:])
    assert covariances.shape == (len(missing.rows), M, M)
    noisy = prior + np.diag([NOISE] * N + [0.0] * M)
    for d in range(D):
        use = np.concatenate([old[:, d], np.ones(M, bool)])
        given = np.concatenate([old[:, d], np.zeros(M, bool)])[use]
        m, V = conditional(noisy[np.ix_(use, use)], given, y[:N][old[:, d], d])
        np.testing.assert_allclose(mean[:, d], m, rtol=1e-7, atol=1e-8)
        pattern = int(np.argmax(missing.columns[:, d]))
        np.testing.assert_allclose(covariances[pattern], V, rtol=1e-7, atol=1e-8)


def test_new_data_after_conditioning_are_the_joint_gaussians(two_sets):
    """Density and smoothing with several covariances equal those of all the data at once."""
    prior, y, old, new = two_sets
    known = condition(y[:N], prior[:N, :N] + NOISE * np.eye(N), patterns(old))
    missing = patterns(new, known.missing)
    loc, K = known(prior[N:, :N], prior[N:, N:])
    both = np.concatenate([old, new])
    everything = prior + NOISE * np.eye(N + M)
    expected = brute_force(y, everything, np.ones(D), both)
    expected -= brute_force(y[:N], everything[:N, :N], np.ones(D), old)
    process = GaussianProcess(K + NOISE * jnp.eye(M), jnp.ones(D), loc, missing)
    np.testing.assert_allclose(process.log_prob(y[N:]), expected, rtol=1e-7)

    mean, smoothed = smooth(y[N:], loc, K, NOISE * np.eye(M), missing)
    shown = np.where(new, y[N:], np.nan)
    again = smooth(shown, loc, K, NOISE * np.eye(M), missing)[0]
    np.testing.assert_array_equal(again, mean)
    for d in range(D):
        # The noise-free new outputs are put after the noisy ones of both sets.
        joint = np.block([[everything, prior[:, N:]], [prior[N:], prior[N:, N:]]])
        use = np.concatenate([both[:, d], np.ones(M, bool)])
        given = np.concatenate([both[:, d], np.zeros(M, bool)])[use]
        m, V = conditional(joint[np.ix_(use, use)], given, y[both[:, d], d])
        np.testing.assert_allclose(mean[:, d], m, rtol=1e-7, atol=1e-8)
        pattern = int(np.argmax(missing.columns[:, d]))
        np.testing.assert_allclose(smoothed[pattern], V, rtol=1e-6, atol=1e-8)


def test_columns_conditioned_on_other_rows_are_kept_apart():
    old = np.ones((N, D), bool)
    old[2:, 1] = False
    first = patterns(old)
    missing = patterns(np.ones((M, D), bool), first)
    assert missing.rows.shape == (2, M)
    for d in range(D):
        own = int(np.argmax(missing.columns[:, d]))
        np.testing.assert_array_equal(first.rows[missing.which[own]], old[:, d])


@pytest.mark.parametrize("several", [False, True])
def test_draws_have_the_process_mean_and_covariance(several: bool):
    n, scale = 3, jnp.array([0.5, 2.0])
    Ks = jnp.stack([covariance(n, 1), covariance(n, 2)])
    loc = jnp.arange(6.0).reshape(n, 2)
    seen = np.ones((n, 2), bool)
    missing = patterns(seen)
    if several:
        missing = patterns(seen, patterns(np.eye(n, 2, dtype=bool)))
    process = GaussianProcess(Ks if several else Ks[0], scale, loc, missing)
    count = 20_000
    draws = np.asarray(process.sample(jax.random.key(0), (count,)))
    assert draws.shape == (count, n, 2)
    for d in range(2):
        group = int(missing.which[np.argmax(missing.columns[:, d])])
        C = np.asarray(Ks[group]) / float(scale[d]) ** 2
        error = np.sqrt(np.diag(C) / count)
        assert (np.abs(draws[:, :, d].mean(axis=0) - loc[:, d]) < 4.5 * error).all()
        # The standard error of an entry of the covariance of Gaussian draws.
        error = np.sqrt((np.outer(np.diag(C), np.diag(C)) + C**2) / count)
        assert (np.abs(np.cov(draws[:, :, d].T) - C) < 4.5 * error).all()
        wrong = np.asarray(Ks[1 - group]) / float(scale[d]) ** 2
        assert (np.abs(np.cov(draws[:, :, d].T) - wrong) > 4.5 * error).any()
    assert process.sample(jax.random.key(0)).shape == (n, 2)
    between = np.cov(draws[:, :, 0].T, draws[:, :, 1].T)[:n, n:]
    sizes = np.outer(draws[:, :, 0].std(axis=0), draws[:, :, 1].std(axis=0))
    assert (np.abs(between) < 4.5 * sizes / np.sqrt(count)).all()


def test_scale_is_one_over_the_spread_and_mean_is_taken_away():
    K, y = covariance(N, 2), np.random.default_rng(1).normal(size=(N, D))
    loc = np.random.default_rng(2).normal(size=(N, D))
    process = GaussianProcess(jnp.asarray(K), jnp.asarray(SCALE), jnp.asarray(loc))
    expected = brute_force(y - loc, K, SCALE, np.ones((N, D), bool))
    np.testing.assert_allclose(process.log_prob(y), expected, rtol=1e-8)
    plain = GaussianProcess(jnp.asarray(K), jnp.asarray(SCALE))
    np.testing.assert_allclose(
        plain.log_prob(y), brute_force(y, K, SCALE, np.ones((N, D), bool)), rtol=1e-8
    )


def test_factor_and_inverse_and_mask():
    K = covariance(N, 9)
    L = cholesky(K)
    np.testing.assert_allclose(L @ L.T, K, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(inverse_factor(L) @ L, np.eye(N), atol=1e-12)
    rows = np.array([1.0, 0.0, 1.0, 1.0, 0.0, 1.0])
    cut = np.asarray(masked(K, rows))
    kept = rows > 0
    np.testing.assert_array_equal(cut[np.ix_(kept, kept)], K[np.ix_(kept, kept)])
    np.testing.assert_array_equal(cut[~kept], np.eye(N)[~kept])
    np.testing.assert_array_equal(cut[:, ~kept], np.eye(N)[:, ~kept])


def test_jitter_is_relative_to_the_size_of_the_matrix():
    """A matrix of rank one is factorised at any scale, by the same small change."""
    ones = np.ones((4, 4))
    for size in (1e-8, 1.0, 1e8):
        L = cholesky(size * ones)
        assert np.isfinite(L).all()
        np.testing.assert_allclose(L @ L.T, size * ones, rtol=1e-9)


def test_a_broken_covariance_is_nan_and_the_site_is_told():
    K = np.array([[1.0, 2.0], [2.0, 1.0]])
    value = log_density(np.ones((2, 3)), K, np.ones(3), complete(2, 3))
    assert np.isnan(value)
    with pytest.raises(NumericalError, match=r"^y: the covariance matrix is not positive definite"):
        require_finite(value, "y")
    with pytest.raises(NumericalError, match=r"^x: "):
        require_finite(np.array([1.0, np.inf]), "x")
    require_finite(log_density(np.ones((2, 3)), np.eye(2), np.ones(3), complete(2, 3)), "y")
