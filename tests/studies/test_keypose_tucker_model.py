"""Tucker with its core integrated out: brute force, limits, missing cells."""

import numpy as np
import pytest
from numpyro.handlers import substitute, trace
from scipy.stats import multivariate_normal

from bayesmotion.errors import InputError
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.inference.optimisation.optimise import maximise
from bayesmotion.studies.keypose.tucker_model import (
    CollapsedTucker,
    additive,
    cells_of,
    mode_sets,
)

D, PEOPLE, TASKS = 3, 3, 4


def example(seed=0, missing=((0, 1), (2, 3))):
    random = np.random.default_rng(seed)
    y = random.normal(size=(D, PEOPLE, TASKS))
    for cell in missing:
        y[(slice(None), *cell)] = np.nan
    y[1, 1, 1] = np.nan  # one joint of a cell
    return cells_of(y, np.array([0, 0, 1]))


def values_of(model, cells, seed=1):
    return {name: v[0] for name, v in model.initial_values(cells, seed, 1).items()}


def by_hand(values):
    """The covariance of each position, from a core and factors written out."""
    blocks = []
    for m, length in ((1, PEOPLE), (2, TASKS)):
        S = values[f"factor_{m}"] * np.exp(-0.5 * values[f"log_precision_{m}"])
        blocks.append(np.concatenate([np.eye(length), S], axis=1))
    ones = [np.ones((PEOPLE, 1)), np.ones((TASKS, 1))]
    variance = np.exp(values["level"][:, None] + values["log_variance"])
    out = []
    for d in range(D):
        total = np.zeros((PEOPLE * TASKS, PEOPLE * TASKS))
        for e, chosen in enumerate(mode_sets(2)):
            A = np.kron(*(blocks[m] if m in chosen else ones[m] for m in (0, 1)))
            total += variance[e, d] * A @ A.T
        out.append(total)
    return out


def test_the_density_and_predictions_are_those_of_gaussians_written_out():
    cells, model = example(), CollapsedTucker((1, 2), joints=2)
    values = values_of(model, cells)
    seen = cells.seen.reshape(D, -1)
    sites = trace(substitute(model.program, data=values)).get_trace(cells)
    found = float(np.asarray(sites["y"]["fn"].log_prob(sites["y"]["value"])))
    mean, sd = model.predict(cells, values)
    expected = 0.0
    for d, K in enumerate(by_hand(values)):
        noise = np.exp(2 * values["log_noise"][cells.joint[d]])
        y, there = cells.y[d].reshape(-1)[seen[d]], np.ix_(seen[d], seen[d])
        C = K[there] + noise * np.eye(len(y))
        expected += multivariate_normal.logpdf(y, cov=C)
        gain = np.linalg.solve(C, K[seen[d]]).T
        np.testing.assert_allclose(mean[d].reshape(-1), gain @ y, atol=1e-7)
        left = np.diag(K - gain @ K[seen[d]])
        np.testing.assert_allclose(sd[d].reshape(-1) ** 2, left, atol=1e-7)
    assert found == pytest.approx(expected, abs=1e-6)


def test_large_effects_without_interaction_are_the_additive_mean():
    cells, model = example(2), CollapsedTucker((0, 0), joints=2)
    values = values_of(model, cells)
    values["level"] = np.array([12.0, 12.0, 12.0, -30.0])
    mean, _ = model.predict(cells, values)
    whole = [0, 2]  # positions whose missing entries are whole cells
    expected = additive(np.where(cells.seen, cells.y, np.nan)[whole])
    np.testing.assert_allclose(mean[whole], expected, atol=1e-3)


def test_levels_that_move_alike_lend_each_other_their_interaction():
    """Tasks in pairs: how a person does one tells how they do the other."""
    random = np.random.default_rng(3)
    people, pairs, positions = 6, 2, 5
    own = random.normal(size=(positions, people, pairs)).repeat(2, axis=2)
    truth = own + 2 * random.normal(size=(positions, 1, 2 * pairs))
    y = truth + 0.1 * random.normal(size=truth.shape)
    away = y.copy()
    gap = [(0, 1), (3, 2), (5, 3), (1, 0)]
    for i, j in gap:
        away[:, i, j] = np.nan
    cells, model = cells_of(away, np.zeros(positions, int)), CollapsedTucker((0, 2))
    found = maximise(
        ProgramDensity(model), model.initial_values(cells, 0, 1), (cells,), max_steps=80
    )
    mean, sd = model.predict(cells, found.best())
    rows, columns = np.array(gap).T
    errors = [
        np.sqrt(np.square(guess - truth)[:, rows, columns].mean())
        for guess in (mean, additive(away))
    ]
    assert errors[0] < 0.7 * errors[1]
    z = (mean - truth)[:, rows, columns] / sd[:, rows, columns]
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.6


def test_any_number_of_modes():
    random = np.random.default_rng(4)
    y = random.normal(size=(2, 2, 3, 2))
    y[:, 1, 2, 0] = np.nan
    cells, model = cells_of(y, np.zeros(2, int)), CollapsedTucker((1, 0, 1))
    values = values_of(model, cells)
    assert len(mode_sets(3)) == len(values["level"]) == 8
    mean, sd = model.predict(cells, values)
    assert mean.shape == y.shape
    assert (sd[:, 1, 2, 0] > sd[:, 1, 2, 1]).all()


def test_ranks_must_fit():
    with pytest.raises(InputError, match="ranks for"):
        CollapsedTucker((1,)).program(example())
