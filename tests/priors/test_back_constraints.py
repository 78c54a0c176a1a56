"""Back-constraints: their maps written out, and weights that begin near given points."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.priors.back_constraints import BackConstraint


@pytest.fixture
def a():
    return np.random.default_rng(0).normal(size=(60, 4))


@pytest.mark.parametrize("kind", ["linear", "mlp", "rbf"])
def test_weights_begin_near_given_points(kind, a):
    x = np.column_stack([a[:, 0] - a[:, 1], 0.5 * a[:, 2] + np.tanh(a[:, 3])])
    constraint, centres = BackConstraint(kind, hidden=20), a[:20]
    weights = constraint.start(a, x, centres, np.random.default_rng(1))
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
    mlp = BackConstraint("mlp", hidden=3)(a, weights, centres)
    np.testing.assert_allclose(mlp, a @ A + np.tanh(a @ U + b) @ V)
    squares = ((a[:, None] - centres) ** 2).sum(axis=2)
    phi = np.exp(-0.5 * squares / (4 * 0.7**2))
    rbf = BackConstraint("rbf", hidden=3, length=0.7)(a, weights, centres)
    np.testing.assert_allclose(rbf, a @ A + phi @ V, rtol=1e-9)
    assert np.array_equal(BackConstraint("identity")(a, {}, centres), a)


def test_what_cannot_be_a_map_is_refused():
    with pytest.raises(InputError, match="not positive"):
        BackConstraint(hidden=0)
    with pytest.raises(InputError, match="it takes 4 numbers to 3"):
        BackConstraint("identity").priors(4, 3)
