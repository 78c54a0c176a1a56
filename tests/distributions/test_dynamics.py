"""Gaussian process dynamics against brute force on paths of a few frames."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from bayesmotion.distributions.dynamics import (
    GPDynamics,
    UnitScale,
    given_steps,
    kernel,
    path_root,
    path_scale,
    roll_out,
    unit_scale,
    with_path,
)
from bayesmotion.distributions.dynamics import steps_of as steps_of_sizes

ALPHA = np.array([0.8, 0.6, 0.4, 5.0])
ALPHA_2 = np.array([0.8, 0.6, 0.9, 0.4, 0.3, 5.0])
ORDERS = {1: ALPHA, 2: ALPHA_2}
Q = 2


def steps_of(*sizes: int):
    return steps_of_sizes(sizes)


def path(n: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, Q))


def k(a, b, alpha=ALPHA) -> float:
    """Wang, Fleet and Hertzmann (2007), eq. 16, without the noise."""
    return alpha[0] * np.exp(-0.5 * alpha[1] * np.sum((a - b) ** 2)) + alpha[2] * np.sum(a * b)


def matrix(a, b, alpha=ALPHA) -> np.ndarray:
    return np.array([[k(one, other, alpha) for other in b] for one in a]).reshape(len(a), len(b))


def log_steps(before, after, alpha=ALPHA) -> float:
    """Log density of all steps as one Gaussian for each latent dimension."""
    K = matrix(before, before, alpha) + np.eye(len(before)) / alpha[3]
    return sum(multivariate_normal(np.zeros(len(K)), K).logpdf(column) for column in after.T)


log_prob = jax.jit(
    lambda alpha, steps, x, given=None, weight=1.0: GPDynamics(
        alpha, steps, x.shape, given, weight
    ).log_prob(x)
)


def test_covariance_is_the_papers_equation():
    a, b = path(3), path(4, 1)
    found = kernel(jnp.asarray(ALPHA)).matrix({"x": a}, {"x": b})
    np.testing.assert_allclose(found, matrix(a, b), rtol=1e-12)


@pytest.mark.parametrize("n", [3, 6])
def test_one_clip_is_the_joint_gaussian(n: int):
    x = path(n)
    expected = norm.logpdf(x[0]).sum() + log_steps(x[:-1], x[1:])
    np.testing.assert_allclose(log_prob(ALPHA, steps_of(n), x), expected, rtol=1e-7)


def test_one_clip_is_the_product_of_its_predictions():
    """Each frame given those before: the chain rule, with h learned on the way."""
    x = path(6)
    expected = (
        norm.logpdf(x[0]).sum()
        + norm.logpdf(x[1], 0.0, np.sqrt(k(x[0], x[0]) + 1 / ALPHA[3])).sum()
    )
    for t in range(2, 6):
        before, after = x[: t - 1], x[1:t]
        K = matrix(before, before) + np.eye(t - 1) / ALPHA[3]
        gain = np.linalg.solve(K, matrix(before, x[t - 1 : t]))[:, 0]
        variance = k(x[t - 1], x[t - 1]) + 1 / ALPHA[3] - gain @ matrix(before, x[t - 1 : t])[:, 0]
        expected += norm.logpdf(x[t], gain @ after, np.sqrt(variance)).sum()
    np.testing.assert_allclose(log_prob(ALPHA, steps_of(6), x), expected, rtol=1e-7)


def by_hand(x, sizes, alpha) -> float:
    """Log density of second order, state by state (Wang, Fleet and Hertzmann 2008, eq. 12)."""
    states, after, total, first = [], [], 0.0, 0
    for size in sizes:
        clip = x[first : first + size]
        total += norm.logpdf(clip[:2]).sum()
        states += [(clip[t - 1], clip[t - 1] - clip[t - 2]) for t in range(2, size)]
        after += list(clip[2:])
        first += size
    K = np.eye(len(states)) / alpha[5]
    for i, (x1, v1) in enumerate(states):
        for j, (x2, v2) in enumerate(states):
            apart = alpha[1] * np.sum((x1 - x2) ** 2) + alpha[2] * np.sum((v1 - v2) ** 2)
            K[i, j] += alpha[0] * np.exp(-0.5 * apart) + alpha[3] * x1 @ x2 + alpha[4] * v1 @ v2
    return total + sum(
        multivariate_normal(np.zeros(len(K)), K).logpdf(c) for c in np.array(after).T
    )


@pytest.mark.parametrize("sizes", [(6,), (4, 3), (1, 5), (2, 4)])
def test_second_order_is_the_joint_gaussian_of_its_steps(sizes):
    x = path(sum(sizes))
    found = log_prob(ALPHA_2, steps_of(*sizes), x)
    np.testing.assert_allclose(found, by_hand(x, sizes, ALPHA_2), rtol=1e-7)


def test_two_frames_are_a_beginning_and_no_step():
    given = given_steps(jnp.asarray(ALPHA_2), path(6), steps_of(6))
    for past in (None, given):
        found = log_prob(ALPHA_2, steps_of(2), path(2, 1), past)
        np.testing.assert_allclose(found, norm.logpdf(path(2, 1)).sum(), rtol=1e-12)
    root = path_root(jnp.asarray(ALPHA_2), path(2), steps_of(2), given, 1.0, 4.0)
    np.testing.assert_allclose(root, 0.5 * np.eye(2), atol=1e-6)
    assert roll_out(with_path(given, jnp.asarray(path(2))), jnp.asarray(path(2)), 5).shape == (5, Q)


def test_second_order_knows_the_velocity():
    """The same places in the other direction go on to other places."""
    x = path(5)
    given = given_steps(jnp.asarray(ALPHA_2), jnp.asarray(x), steps_of(5))
    there, back = jnp.asarray(path(2, 1)), jnp.asarray(path(2, 1) * [[-1.0, 1.0], [1.0, 1.0]])
    np.testing.assert_array_equal(there[1], back[1])
    one, other = (roll_out(given, begun, 3)[2] for begun in (there, back))
    assert np.abs(one - other).max() > 1e-3


def test_no_step_leads_from_one_clip_into_another():
    one, other = path(4), path(3, 1)
    both = np.concatenate([one, other])
    expected = norm.logpdf(one[0]).sum() + norm.logpdf(other[0]).sum()
    expected += log_steps(
        np.concatenate([one[:-1], other[:-1]]), np.concatenate([one[1:], other[1:]])
    )
    found = log_prob(ALPHA, steps_of(4, 3), both)
    np.testing.assert_allclose(found, expected, rtol=1e-7)
    # So clips have no order,
    swapped = np.concatenate([other, one])
    np.testing.assert_allclose(log_prob(ALPHA, steps_of(3, 4), swapped), expected, rtol=1e-7)
    # and one clip of both would be something else.
    assert abs(log_prob(ALPHA, steps_of(7), both) - expected) > 0.1


def test_clips_share_the_function():
    """Two clips are not independent: the steps of one teach the other."""
    one, other = path(4), path(4) + 0.01
    both = log_prob(ALPHA, steps_of(4, 4), np.concatenate([one, other]))
    apart = log_prob(ALPHA, steps_of(4), one) + log_prob(ALPHA, steps_of(4), other)
    assert both > apart + 0.5


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("weight", [1.0, 7.5])
def test_given_steps_are_conditioned_on(weight: float, order: int):
    """log p(new | given) = log p(given and new) - log p(given), balanced or not."""
    alpha, old, new = ORDERS[order], path(5), path(4, 1)
    given = given_steps(jnp.asarray(alpha), old, steps_of(3, 2))
    everything = log_prob(alpha, steps_of(3, 2, 4), np.concatenate([old, new]), None, weight)
    expected = everything - log_prob(alpha, steps_of(3, 2), old, None, weight)
    found = log_prob(alpha, steps_of(4), new, given, weight)
    np.testing.assert_allclose(found, expected, rtol=1e-7)
    assert abs(found - log_prob(alpha, steps_of(4), new, None, weight)) > 0.1


def test_weight_multiplies_the_steps_alone():
    x = path(6)
    start = norm.logpdf(x[[0, 4]]).sum()
    plain = log_prob(ALPHA, steps_of(4, 2), x) - start
    found = log_prob(ALPHA, steps_of(4, 2), x, None, 30.0)
    np.testing.assert_allclose(found, start + 30.0 * plain, rtol=1e-10)


def predicted(old, steps, here) -> np.ndarray:
    """Mean of what follows `here`, given the steps of `old`, by plain regression."""
    before, after = old[steps.before], old[steps.after]
    K = matrix(before, before) + np.eye(len(before)) / ALPHA[3]
    return matrix(here, before) @ np.linalg.solve(K, after)


def test_rolling_out_follows_the_mean_step_by_step():
    old, begun, steps = path(6), path(2, 1), steps_of(4, 2)
    given = given_steps(jnp.asarray(ALPHA), jnp.asarray(old), steps)
    found = roll_out(given, jnp.asarray(begun), 5)
    expected = list(begun)
    for _ in range(3):
        expected.append(predicted(old, steps, expected[-1][None])[0])
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)
    np.testing.assert_array_equal(roll_out(given, jnp.asarray(begun), 2), begun)


def of_unit_scale(x: np.ndarray, *sizes: int) -> tuple[np.ndarray, np.ndarray]:
    """Means of the clips, row by row, and the movement about them, scaled to unit mean square."""
    rows = np.split(x, np.cumsum(sizes)[:-1])
    means = np.concatenate([np.broadcast_to(row.mean(axis=0), row.shape) for row in rows])
    return means, (x - means) / np.sqrt(np.mean((x - means) ** 2))


def test_unit_scale_looks_at_how_clips_move_and_not_at_where_they_are():
    x, steps = path(7), steps_of(4, 3)
    means, moving = of_unit_scale(x, 4, 3)
    np.testing.assert_allclose(path_scale(means + 3.0 * moving, steps), 3.0, rtol=1e-12)
    found = unit_scale(means + 3.0 * moving, steps)
    np.testing.assert_allclose(found, means + moving, rtol=1e-12)
    process = GPDynamics(jnp.asarray(ALPHA), steps, (7, Q))
    scaled = UnitScale(process)
    score = jax.jit(scaled.log_prob)
    at_unit = score(means + moving)
    for size in (0.5, 20.0):
        expected = -0.5 * (7 - 2) * Q * np.log(size) ** 2
        found = score(means + size * moving) - at_unit
        np.testing.assert_allclose(found, expected, rtol=1e-9)
    # Of two paths of one scale the path's own density decides, and it knows where they are.
    for far, other in ((0.0, of_unit_scale(path(7, 1), 4, 3)[1]), (2.0, moving)):
        expected = log_prob(ALPHA, steps, means + far + other) - log_prob(
            ALPHA, steps, means + moving
        )
        found = score(means + far + 2.0 * other) - score(means + 2.0 * moving)
        np.testing.assert_allclose(found, expected, rtol=1e-8)
        assert abs(found) > 0.1
    draws = np.asarray(jax.jit(lambda key: scaled.sample(key, (3,)))(jax.random.key(0)))
    scales = [path_scale(draw, steps) for draw in draws]
    np.testing.assert_allclose(scales, 1.0, rtol=1e-12)


def test_unit_scale_has_the_mass_that_the_path_has_where_its_scale_is_one():
    """Two frames in one dimension, x = m +- r: over all r its mass is that at r = 1."""
    process = GPDynamics(jnp.asarray(ALPHA), steps_of(2), (2, 1))
    score = jax.jit(jax.vmap(UnitScale(process).log_prob))
    of_unit = jax.jit(jax.vmap(process.log_prob))
    m = np.linspace(-8.0, 8.0, 401)
    log_r = np.linspace(-7.0, 7.0, 401)
    side = np.array([-1.0, 1.0])
    at_one = m[:, None, None] + side[None, :, None] * np.array([-1.0, 1.0])
    expected = np.exp(of_unit(at_one.reshape(-1, 2, 1))).sum()
    r = np.exp(log_r)
    around = m[:, None, None, None] + side[:, None] * r[:, None, None] * np.array([-1.0, 1.0])
    # The movement has one dimension, r along it: dx = dm dr up to one constant for both.
    density = np.exp(score(around.reshape(-1, 2, 1))).reshape(len(m), len(r), 2)
    mass = (density.sum(axis=(0, 2)) * r).sum() * (log_r[1] - log_r[0])
    np.testing.assert_allclose(mass, expected, rtol=1e-5)


def loop(step: float, n: int) -> np.ndarray:
    angle = 0.7 + step * np.arange(n)
    return 1.4 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize(("order", "keeps"), [(1, False), (2, True)])
def test_second_order_goes_on_at_the_speed_it_came(order: int, keeps: bool):
    """Two clips go round one loop, one slowly, one fast; a third has a speed between."""
    alpha = {1: [0.1, 1.0, 1.0, 1e4], 2: [0.01, 0.3, 3.0, 1.0, 1.0, 1e6]}[order]
    old = np.concatenate([loop(0.15, 60), loop(0.3, 60)])
    given = given_steps(jnp.asarray(alpha), jnp.asarray(old), steps_of(60, 60))
    true = loop(0.25, 55)
    begun = jnp.asarray(true[:15])
    going_on = np.asarray(roll_out(with_path(given, begun), begun, 55))
    error = np.linalg.norm(going_on - true, axis=1).max()
    assert error < 0.4 if keeps else error > 0.8
    # A clip at a speed that was seen goes on as that one did, or again does not.
    slow = jnp.asarray(loop(0.15, 15))
    error = np.linalg.norm(roll_out(given, slow, 55) - loop(0.15, 55), axis=1).max()
    assert error < 0.01 if keeps else error > 0.8


@pytest.mark.parametrize("order", ORDERS)
def test_the_root_is_that_of_the_covariance_it_says(order: int):
    alpha, steps, x = jnp.asarray(ORDERS[order]), steps_of(5, 4), path(9)
    root = path_root(alpha, x, steps, None, 2.0, 3.0)
    stencil = [[-1.0, 1.0], [1.0, -2.0, 1.0]][order - 1]
    firsts = [i for i in range(9) if i + order < 9 and (i < 5) == (i + order < 5)]
    B = np.zeros((len(firsts), 9))
    for row, first in enumerate(firsts):
        B[row, first : first + order + 1] = stencil
    states = {"x": x[np.array(firsts) + order - 1]}
    states["v"] = states["x"] - x[np.array(firsts) + order - 2]
    K = kernel(alpha).matrix(states, states) + np.eye(len(firsts)) / alpha[-1]
    expected = 3.0 * np.eye(9) + 2.0 * B.T @ np.linalg.solve(K, B)
    np.testing.assert_allclose(np.linalg.inv(root @ root.T), expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("with_given", [False, True])
def test_a_draw_is_a_change_of_variables_with_the_density_of_log_prob(
    with_given: bool, order: int, monkeypatch: pytest.MonkeyPatch
):
    """A draw x = f(white noise z) has log p(x) = log N(z) - log |det dx/dz|, exactly."""
    alpha, steps = jnp.asarray(ORDERS[order]), steps_of(4, 3)
    given = given_steps(alpha, path(5), steps_of(5)) if with_given else None
    process = GPDynamics(alpha, steps, (7, Q), given)

    def draw(white):
        with monkeypatch.context() as patch:
            patch.setattr(jax.random, "normal", lambda key, shape: white.reshape(shape))
            return process.sample(jax.random.key(0)).ravel()

    white = np.random.default_rng(2).normal(size=7 * Q)
    x, slopes = jax.jit(lambda z: (draw(z), jax.jacrev(draw)(z)))(white)
    expected = norm.logpdf(white).sum() - np.linalg.slogdet(slopes)[1]
    np.testing.assert_allclose(process.log_prob(x.reshape(7, Q)), expected, rtol=1e-7)


def moments_agree(squares: np.ndarray, expected: float) -> bool:
    error = squares.std() / np.sqrt(len(squares))
    return bool(abs(squares.mean() - expected) < 4.5 * error)


def test_draws_of_linear_dynamics_have_their_second_moments():
    """x_t = W x_(t-1) + noise with W ~ N(0, a_3): E|x_2|^2 and the shared W are known."""
    alpha = jnp.array([1e-12, 1.0, 0.5, 4.0])
    process = GPDynamics(alpha, steps_of(2, 2), (4, 1))
    draws = np.asarray(jax.jit(lambda key: process.sample(key, (40_000,)))(jax.random.key(1)))
    assert draws.shape == (40_000, 4, 1)
    x = draws[:, :, 0]
    # E x_2^2 = a_3 E x_1^2 + 1 / a_4.
    assert moments_agree(x[:, 0] ** 2, 1.0)
    assert moments_agree(x[:, 1] ** 2, 0.5 + 0.25)
    assert moments_agree(x[:, 3] ** 2, 0.5 + 0.25)
    # Both clips have one W: E x_1 x_2 y_1 y_2 = a_3 E x_1^2 E y_1^2, but E x_2 y_1 = 0.
    assert moments_agree(x[:, 0] * x[:, 1] * x[:, 2] * x[:, 3], 0.5)
    assert not moments_agree(x[:, 0] * x[:, 1] * x[:, 2] * x[:, 3], 0.0)
    assert moments_agree(x[:, 1] * x[:, 2], 0.0)


def test_draws_given_steps_have_the_predicted_mean_and_spread():
    alpha, old = jnp.asarray(ALPHA), path(6)
    given = given_steps(alpha, old, steps_of(6))
    process = GPDynamics(alpha, steps_of(2), (2, Q), given)
    draws = np.asarray(jax.jit(lambda key: process.sample(key, (4_000,)))(jax.random.key(2)))
    start, after = draws[:, 0], draws[:, 1]
    residual = after - predicted(old, steps_of(6), start)
    K = matrix(old[:-1], old[:-1]) + np.eye(5) / ALPHA[3]
    cross = matrix(start, old[:-1])
    own = ALPHA[0] + ALPHA[2] * np.sum(start**2, axis=1) + 1 / ALPHA[3]
    variance = own - np.sum(cross * np.linalg.solve(K, cross.T).T, axis=1)
    standard = residual / np.sqrt(variance)[:, None]
    for d in range(Q):
        assert moments_agree(standard[:, d], 0.0)
        assert moments_agree(standard[:, d] ** 2, 1.0)
    assert moments_agree(standard[:, 0] * standard[:, 1], 0.0)


def test_draws_of_several_shapes():
    process = GPDynamics(jnp.asarray(ALPHA), steps_of(2, 1), (3, Q))
    draws = process.sample(jax.random.key(0), (2, 3))
    assert draws.shape == (2, 3, 3, Q)
    assert len(np.unique(np.asarray(draws).round(12))) == draws.size
