"""Bayesian Tucker: its flat mode is least squares; missing cells; ranks found."""

import jax
import numpy as np
import pytest
from numpyro.infer import MCMC, NUTS

from bayesmotion.errors import InputError
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.inference.optimise import maximise
from bayesmotion.models.hosvd import alternating
from bayesmotion.models.tucker import BayesianTucker, additive, cells_of, multiply


def low_rank(seed=0, shape=(8, 5, 6), ranks=(3, 2, 2), noise=0.05):
    random = np.random.default_rng(seed)
    factors = [random.normal(size=(n, r)) for n, r in zip(shape, ranks, strict=True)]
    core = random.normal(size=ranks)
    truth = np.asarray(multiply(core, factors))
    truth = truth / truth.std()
    return truth, truth + noise * random.normal(size=shape)


# More columns than any truth here has; two tests share its compilation.
WIDE = BayesianTucker((4, 3, 3), joints=4, constant=False)


def mode_of(model, cells, seed=0, steps=400):
    found = maximise(ProgramDensity(model), model.initial_values(cells, seed, 4), (cells,),
                     max_steps=steps, tolerance=1e-12, keep=2, trial_steps=100)  # fmt: skip
    return found.best()


def test_the_mode_with_flat_priors_is_alternating_least_squares():
    _, y = low_rank(noise=0.3)
    cells = cells_of(y, np.zeros(8, int))
    ranks = (3, 2, 2)
    model = BayesianTucker(ranks, priors="flat", constant=False)
    found = model.tensor(mode_of(model, cells))
    np.testing.assert_allclose(found, alternating(y, ranks).tensor(), atol=2e-3)


def test_missing_cells_are_predicted_better_than_by_the_additive_mean():
    truth, y = low_rank(1)
    away = y.copy()
    for i, j in ((0, 1), (2, 3), (4, 5), (1, 0)):
        away[:, i, j] = np.nan
    cells = cells_of(away, np.arange(8) // 2)
    found = WIDE.tensor(mode_of(WIDE, cells))
    gap = np.isnan(away)
    error = np.sqrt(np.square(found - truth)[gap].mean())
    plain = np.sqrt(np.square(additive(away) - truth)[gap].mean())
    assert error < 0.3
    assert error < 0.5 * plain


def test_the_additive_mean_is_exact_on_an_additive_tensor():
    random = np.random.default_rng(2)
    y = random.normal(size=(6, 4, 1)) + random.normal(size=(6, 1, 5))
    np.testing.assert_allclose(additive(y), y, atol=1e-12)


def test_superfluous_columns_are_shrunk():
    _, y = low_rank(3, ranks=(2, 1, 1))
    found = mode_of(WIDE, cells_of(y, np.arange(8) // 2), steps=600)
    columns = np.linalg.norm(found["factor_1"], axis=0)
    sizes = np.sort(columns * np.sqrt(np.square(found["core"]).sum(axis=(0, 2))))
    assert sizes[-1] > 5 * sizes[0]


@pytest.mark.slow
def test_nuts_agrees_with_the_mode_on_the_tensor():
    """Factors are known up to rotations; the tensor they give is not."""
    _, y = low_rank(4, shape=(4, 3, 3), ranks=(1, 1, 1), noise=0.2)
    cells = cells_of(y, np.zeros(4, int))
    model = BayesianTucker((1, 1, 1), constant=False)
    mcmc = MCMC(NUTS(model.program), num_warmup=100, num_samples=100, progress_bar=False)
    mcmc.run(jax.random.key(0), cells)
    draws = mcmc.get_samples()
    tensors = np.stack([model.tensor({k: v[i] for k, v in draws.items()}) for i in range(100)])
    mode = model.tensor(mode_of(model, cells))
    assert np.abs(tensors.mean(axis=0) - mode).max() < 4 * tensors.std(axis=0).max()


def test_bad_input_is_told():
    with pytest.raises(InputError, match="nothing to learn"):
        cells_of(np.full((2, 2, 2), np.nan), np.zeros(2, int))
    away = np.ones((2, 2, 2))
    away[:, 0] = np.nan
    with pytest.raises(InputError, match="no cell"):
        additive(away)
