"""The tree of a fit: its groups add up to the program's density, and it comes back whole."""

import arviz as az
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayesmotion import registry
from bayesmotion.errors import InputError
from bayesmotion.inference.density import ProgramDensity, real_values
from bayesmotion.inference.optimisation.map import fit_map
from bayesmotion.inference.results import data_hash, log_densities
from bayesmotion.models.multifactor import Multifactor
from bayesmotion.models.multifactor.data import prepare
from bayesmotion.motion.synthetic.walkers import synthetic_walkers


@pytest.fixture(scope="session")
def two_walkers():
    return synthetic_walkers(("ann", "ben"), gaits=("walk",), seconds=1.0, frame_rate=20.0)


def test_parts_are_those_of_each_draw(line, line_motion):
    training = line.prepare(line_motion)
    random = np.random.default_rng(1)
    draws = {name: random.normal(size=(2, 5, 2)) for name in ("a", "b")}
    draws["noise"] = np.exp(random.normal(size=(2, 5, 2)))
    likelihood, prior = log_densities(line, draws, training.data)
    assert likelihood["y"].shape == (2, 5, 30, 2)
    density = ProgramDensity(line)
    for chain, draw in ((0, 0), (1, 3)):
        one = {name: jnp.asarray(value[chain, draw]) for name, value in draws.items()}
        whole = float(jax.jit(density)(density.real(one, training.data), training.data))
        parts = likelihood["y"][chain, draw].sum() + sum(p[chain, draw] for p in prior.values())
        assert parts == pytest.approx(whole, rel=1e-12)


def test_columns_of_a_gaussian_process_are_parts(two_walkers):
    """Missing entries too; with the paper's priors, whose improper parts are factors."""
    walkers = two_walkers.copy(deep=True)
    walkers["angle"][3:6, 5] = np.nan
    model = Multifactor(priors="paper")
    training = model.prepare(walkers)
    start = model.initial_values(training, 0, 1)[0]
    draws = {name: np.asarray(value)[None, None] for name, value in start.items()}
    likelihood, prior = log_densities(model, draws, training.data)
    assert likelihood["y"].shape == (1, 1, training.frames.y.shape[1])
    assert "gamma_prior" in prior
    density = ProgramDensity(model)
    whole = float(jax.jit(density)(real_values(density, start, training.data), training.data))
    parts = likelihood["y"].sum() + sum(p.sum() for p in prior.values())
    assert parts == pytest.approx(whole, rel=1e-10)


def test_the_hash_is_of_what_is_explained(two_walkers):
    both = prepare(two_walkers, ("subject", "gait"))
    assert data_hash(both) == data_hash(prepare(two_walkers, ()))
    other = two_walkers.copy(deep=True)
    other["angle"][0, 0] += 1e-9
    assert data_hash(both) != data_hash(prepare(other, ("subject", "gait")))
    renamed = two_walkers.assign_coords(clip=two_walkers["clip"].str.replace("ann", "eva"))
    assert data_hash(both) != data_hash(prepare(renamed, ("subject", "gait")))


def test_settings_of_another_version_are_refused():
    settings = registry.describe_model(Multifactor())
    with pytest.raises(InputError, match="another version"):
        registry.build_model({**settings, "colour": "red"}, "here")
    with pytest.raises(InputError, match="'nothing'"):
        registry.build_model({"name": "nothing"}, "here")


def test_arviz_reads_the_tree(line, line_motion):
    fit = fit_map(line, line_motion)
    assert az.extract(fit.tree)["a"].sizes == {"output": 2, "sample": 1}
