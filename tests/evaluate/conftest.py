"""One small fit, and draws around it made by hand."""

import json
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from bayesmotion.fit import Fit
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.inference.results import Record, make_fit
from bayesmotion.models.multifactor import GPDynamics, Multifactor
from bayesmotion.motion.synthetic.walkers import synthetic_walkers

RATE = 15.0


@pytest.fixture(scope="session")
def walkers():
    return synthetic_walkers(("ann", "ben"), ("walk", "run"), seconds=1.2, frame_rate=RATE)


def start_of(model: Multifactor, motion: xr.Dataset, index: int = 0) -> Fit:
    """Give a point where the search for the mode begins, as a fit: it is near enough."""
    training = model.prepare(motion)
    density, data = ProgramDensity(model), training.data
    start = model.initial_values(training, 0, index + 1)[index]
    values = density.natural(density.real(start, data), data)
    draws = {name: np.asarray(value)[None, None] for name, value in values.items()}
    figures = {"lp": 0.0, "converged": True, "steps": 60}
    stats = {name: np.array([[value]]) for name, value in figures.items()}
    return make_fit(model, motion, training, draws, stats, Record("map", {}, 0, 0.0))


@pytest.fixture(scope="session")
def map_fit(walkers) -> Fit:
    return start_of(Multifactor(), walkers)


@pytest.fixture(scope="session")
def gp_fit(walkers) -> Fit:
    return start_of(Multifactor(GPDynamics()), walkers, index=1)


@partial(jax.jit, static_argnames="density")
def natural(density: ProgramDensity, data: tuple, draws: dict) -> dict:
    """Take many draws on the real line to the sites' own units."""
    return jax.vmap(lambda real: density.natural(real, data))(draws)


def draws_around(fit: Fit, chains: int = 4, draws: int = 100, size: float = 0.02, seed: int = 0):
    """Give a fit whose draws are its values with independent noise on the real line."""
    density, data = ProgramDensity(fit.model), fit.training.data
    centre = density.real(fit.values(), data)
    random = np.random.default_rng(seed)
    count = chains * draws
    noisy = {n: v + size * random.normal(size=(count, *v.shape)) for n, v in centre.items()}
    stacked = natural(density, data, noisy)
    dims, coords = fit.model.dims(), fit.model.coords(fit.training)
    posterior = xr.Dataset(
        {
            n: (("chain", "draw", *dims[n]), np.asarray(v).reshape(chains, draws, *v.shape[1:]))
            for n, v in stacked.items()
        },
        {"chain": range(chains), "draw": range(draws)}
        | {d: coords[d] for n in stacked for d in dims[n]},
    )
    return with_posterior(fit, posterior, random)


def with_posterior(fit: Fit, posterior: xr.Dataset, random: np.random.Generator) -> Fit:
    """Give a fit with other draws, as a sampler would leave it."""
    shape = (posterior.sizes["chain"], posterior.sizes["draw"])
    stats = {
        "diverging": np.zeros(shape, bool),
        "energy": random.normal(size=shape),
        "lp": random.normal(size=shape),
        "reached_max_treedepth": np.zeros(shape, bool),
    }
    tree = fit.tree.copy()
    tree["posterior"] = xr.DataTree(posterior)
    tree["sample_stats"] = xr.DataTree(
        xr.Dataset({name: (("chain", "draw"), value) for name, value in stats.items()})
    )
    # That of the values from which these draws were made says nothing of them.
    tree["log_prior"] = xr.DataTree()
    tree.attrs |= {"inference": "nuts", "warnings": json.dumps([])}
    return Fit(fit.model, fit.motion, tree)


def edited(fit: Fit, name: str, change) -> Fit:
    """Give a fit with one site's draws changed; sites must be independent of it."""
    posterior = fit.tree["posterior"].to_dataset().copy(deep=True)
    posterior[name] = change(posterior[name])
    return with_posterior(fit, posterior, np.random.default_rng(1))


@pytest.fixture(scope="session")
def drawn_fit(map_fit) -> Fit:
    return draws_around(map_fit)


@pytest.fixture(scope="session")
def drawn_gp_fit(gp_fit) -> Fit:
    return draws_around(gp_fit, chains=2, draws=3)


def jnp_values(fit: Fit, chain: int, draw: int) -> dict:
    return {name: jnp.asarray(value) for name, value in fit.values(chain, draw).items()}
