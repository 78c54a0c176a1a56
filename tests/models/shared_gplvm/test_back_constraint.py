"""Back-constraints and their windows: maps written out, weights that begin near points."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.models.shared_gplvm import (
    MLP,
    RBF,
    BackConstraint,
    ContextWindow,
    Identity,
    Linear,
)
from bayesmotion.models.shared_gplvm.window import learn_components


@pytest.fixture
def a():
    return np.random.default_rng(0).normal(size=(60, 4))


@pytest.mark.parametrize("kind", [Linear(), MLP(hidden=20), RBF(hidden=20)])
def test_weights_begin_near_given_points(kind, a):
    x = np.column_stack([a[:, 0] - a[:, 1], 0.5 * a[:, 2] + np.tanh(a[:, 3])])
    constraint, centres = BackConstraint(map=kind), a[:20]
    weights = constraint.weights_near(a, x, centres, np.random.default_rng(1))
    assert set(weights) == set(constraint.priors(4, 2))
    for name, prior in constraint.priors(4, 2).items():
        assert weights[name].shape == prior.event_shape
    found = np.asarray(constraint(a, weights, centres))
    assert np.sqrt(np.mean((found - x) ** 2)) < 0.3 * np.sqrt(np.mean(x**2))


def test_the_maps_are_as_written(a):
    random = np.random.default_rng(2)
    A, V, U, b = (random.normal(size=s) for s in ((4, 2), (3, 2), (4, 3), (3,)))
    weights = {"back_linear": A, "back_out": V, "back_hidden": U, "back_bias": b}
    centres = a[:3]
    mlp = BackConstraint(map=MLP(hidden=3))(a, weights, centres)
    np.testing.assert_allclose(mlp, a @ A + np.tanh(a @ U + b) @ V)
    squares = ((a[:, None] - centres) ** 2).sum(axis=2)
    phi = np.exp(-0.5 * squares / (4 * 0.7**2))
    rbf = BackConstraint(map=RBF(hidden=3, length=0.7))(a, weights, centres)
    np.testing.assert_allclose(rbf, a @ A + phi @ V, rtol=1e-9)
    assert np.array_equal(BackConstraint(map=Identity())(a, {}, centres), a)


def test_windows_see_their_clip_alone_and_count_less_far_off():
    window = ContextWindow(half_width=1, lag_scale=2.0, feature_scale=np.inf, components=99)
    near = np.exp(-0.125)
    expected = [[0, 0, near], [0, 1, 2 * near], [near, 2, 2 * near]]
    np.testing.assert_allclose(window(np.arange(3.0)[:, None]), expected)
    one = ContextWindow(half_width=0, feature_scale=1.0)(np.ones((2, 2)))
    np.testing.assert_allclose(one, [[1, np.exp(-0.5)]] * 2)


def test_what_is_missing_stands_at_its_mean(a):
    components = learn_components([a], ContextWindow(half_width=1, components=5))
    holes, zeros = a.copy(), a.copy()
    holes[3, 1], zeros[3, 1] = np.nan, 0.0
    np.testing.assert_array_equal(components(holes), components(zeros))


def test_what_cannot_be_a_map_is_refused():
    with pytest.raises(InputError, match="not positive"):
        BackConstraint(map=MLP(hidden=0))
    with pytest.raises(InputError, match="not positive"):
        ContextWindow(lag_scale=0.0)
    with pytest.raises(InputError, match="it takes 4 numbers to 3"):
        BackConstraint(map=Identity()).priors(4, 3)
