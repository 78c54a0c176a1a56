"""A clip followed frame by frame against the joint normal distribution of all its frames."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayesmotion.distributions.circle import circle
from bayesmotion.gp.followed import (
    Coefficients,
    Residual,
    Rows,
    ahead,
    follow,
    gone,
    log_density,
    nothing,
)
from bayesmotion.gp.harmonics import waves

FRAMES, AHEAD, WINDOW, D = 30, 4, 12, 3
GROUP = np.array([0, 0, 1])
RESIDUAL = Residual(jnp.array(0.4), jnp.array(np.exp(-0.25)), jnp.array(0.05))
SCALE = np.array([1.0, 2.0, 0.5])
E = waves(circle(0.3 * jnp.arange(FRAMES + AHEAD)), jnp.ones(4))


@pytest.fixture(scope="module")
def clip():
    """Outputs, what is seen of them by group (G, N), and what is known of the coefficients."""
    random = np.random.default_rng(0)
    seen = np.ones((2, FRAMES))
    seen[0, 3], seen[1, [5, 20, 21]], seen[:, 8] = 0.0, 0.0, 0.0
    root = np.tril(random.normal(size=(2, 7, 7))) / 3.0
    y = random.normal(size=(FRAMES, D))
    known = Coefficients(random.normal(size=(7, D)), root)
    return np.where(seen[GROUP].T > 0.0, y, 0.0), seen, known


def rows_of(y, seen, parent=(0, 1)):
    rows, known = np.zeros((WINDOW, D)), np.zeros((len(seen), WINDOW))
    rows[: len(y)], known[:, : len(y)] = y, seen
    columns = (np.arange(2)[:, None] == GROUP).astype(float)
    return Rows(rows, known, columns, np.array(parent), np.array(len(y)))


def followed(clip, left):
    """Follow all frames, of which so many are gone."""
    y, seen, _ = clip
    past = nothing(2, E.shape[1], D)
    for frame in range(left):
        past = gone(past, y[frame], seen[:, frame], GROUP, E[frame], RESIDUAL)
    return past, rows_of(y[left:], seen[:, left:])


def joint(clip, column):
    """Return mean, covariance and the seen frames of a column, and of those that follow."""
    _, seen, known = clip
    apart = np.abs(np.subtract.outer(np.arange(len(E)), np.arange(len(E))))
    half = np.asarray(E) @ known.root[GROUP[column]]
    K = half @ half.T + 0.4 * np.exp(-0.25 * apart) + 0.05 * np.eye(len(E))
    there = np.append(np.flatnonzero(seen[GROUP[column]]), np.arange(FRAMES, FRAMES + AHEAD))
    mean = np.asarray(E) @ known.mean[:, column]
    return mean[there], K[np.ix_(there, there)] / SCALE[column] ** 2, there[:-AHEAD]


LEFT = (FRAMES - WINDOW, FRAMES - 5)


@pytest.mark.parametrize("left", LEFT)
def test_the_density_of_all_frames_is_that_of_their_joint_distribution(clip, left):
    past, rows = followed(clip, left)
    says = follow(past, rows, _window(left), RESIDUAL)
    total = 0.0
    for column in range(D):
        mean, K, seen = joint(clip, column)
        off = clip[0][seen, column] - mean[:-AHEAD]
        known = K[:-AHEAD, :-AHEAD]
        total -= 0.5 * (off @ np.linalg.solve(known, off) + np.linalg.slogdet(2 * np.pi * known)[1])
    found = log_density(says, rows, clip[2], SCALE)
    np.testing.assert_allclose(found, total, rtol=1e-10)


@pytest.mark.parametrize("left", LEFT)
def test_what_follows_is_that_of_the_joint_distribution(clip, left):
    past, rows = followed(clip, left)
    here = _window(left)
    says = follow(past, rows, here, RESIDUAL)
    found = ahead(past, rows, says, clip[2], RESIDUAL, (here, E[FRAMES:]), SCALE, None)
    for column in range(D):
        mean, K, seen = joint(clip, column)
        off = clip[0][seen, column] - mean[:-AHEAD]
        gain = np.linalg.solve(K[:-AHEAD, :-AHEAD], K[:-AHEAD, -AHEAD:]).T
        np.testing.assert_allclose(found.mean[:, column], mean[-AHEAD:] + gain @ off, rtol=1e-8)
        K = K[-AHEAD:, -AHEAD:] - gain @ K[:-AHEAD, -AHEAD:]
        own = np.asarray(found.covariance)[GROUP[column]] + 0.05 * np.eye(AHEAD)
        np.testing.assert_allclose(own / SCALE[column] ** 2, K, rtol=1e-7, atol=1e-10)


def test_a_past_without_its_last_frame_says_something_else(clip):
    past, rows = followed(clip, LEFT[0])
    less = nothing(2, E.shape[1], D)
    for frame in range(LEFT[0] - 1):
        less = gone(less, clip[0][frame], clip[1][:, frame], GROUP, E[frame], RESIDUAL)
    found = [
        float(log_density(follow(one, rows, _window(LEFT[0]), RESIDUAL), rows, clip[2], SCALE))
        for one in (past, less)
    ]
    assert abs(found[0] - found[1]) > 0.1


def test_groups_that_split_keep_their_past(clip):
    y, seen, known = clip
    alike = np.ones((2, 1)) * seen[:1]
    past, rows = nothing(1, E.shape[1], D), rows_of(y[9:20], seen[:, 9:20], parent=(0, 0))
    both = nothing(2, E.shape[1], D)
    for frame in range(9):
        one = np.where(alike[0, frame], y[frame], 0.0)
        past = gone(past, one, alike[:1, frame], np.zeros(D, int), E[frame], RESIDUAL)
        both = gone(both, one, alike[:, frame], GROUP, E[frame], RESIDUAL)
    rows_both = rows._replace(parent=np.array([0, 1]))
    found = log_density(follow(past, rows, _window(9, 20), RESIDUAL), rows, known, SCALE)
    true = log_density(follow(both, rows_both, _window(9, 20), RESIDUAL), rows_both, known, SCALE)
    np.testing.assert_allclose(found, true, rtol=1e-12)


def test_the_gradient_is_that_of_differences(clip):
    past, rows = followed(clip, LEFT[0])

    def density(log_variance):
        residual = RESIDUAL._replace(variance=jnp.exp(log_variance))
        return log_density(follow(past, rows, _window(LEFT[0]), residual), rows, clip[2], SCALE)

    slope = jax.grad(density)(0.1)
    np.testing.assert_allclose(slope, (density(0.101) - density(0.099)) / 0.002, rtol=1e-5)


def _window(left, end=FRAMES):
    return jnp.pad(E[left:end], ((0, WINDOW - (end - left)), (0, 0)))
