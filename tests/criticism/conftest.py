"""One small fit, and draws around it made by hand."""

import json
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from bayesmotion.errors import MotionWarning
from bayesmotion.fit import Fit
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.inference.map import fit_map
from bayesmotion.models.multifactor import Multifactor
from bayesmotion.motion.synthetic import synthetic_walkers

RATE = 15.0


@pytest.fixture(scope="session")
def walkers():
    return synthetic_walkers(("ann", "ben"), ("walk", "run"), seconds=1.2, frame_rate=RATE)


def small_map(motion: xr.Dataset, dynamics="circle", steps: int = 60, **settings) -> Fit:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MotionWarning)
        model = Multifactor(dynamics, frame_rate=RATE, **settings)
        return fit_map(model, motion, starts=1, keep=1, max_steps=steps)


@pytest.fixture(scope="session")
def map_fit(walkers) -> Fit:
    return small_map(walkers)


@pytest.fixture(scope="session")
def gp_fit(walkers) -> Fit:
    return small_map(walkers, "gp", steps=20)


def draws_around(fit: Fit, chains: int = 4, draws: int = 100, size: float = 0.02, seed: int = 0):
    """Give a fit whose draws are its values with independent noise on the real line."""
    density, data = ProgramDensity(fit.model), (fit.training.frames,)
    centre = density.real(fit.values(), data)
    random = np.random.default_rng(seed)
    count = chains * draws
    noisy = {n: v + size * random.normal(size=(count, *v.shape)) for n, v in centre.items()}
    stacked = jax.jit(jax.vmap(lambda real: density.natural(real, data)))(noisy)
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
