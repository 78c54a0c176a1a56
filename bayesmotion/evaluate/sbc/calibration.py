"""Simulation-based calibration: does the sampler's posterior mean what it says?

Cook, Gelman and Rubin (2006), Talts et al. (2018). Draw from the joint distribution,

    theta ~ p(theta),  y ~ p(y | theta),

and then theta_1..theta_L from the posterior p(theta | y) as the sampler has it. If
prior, program, density and sampler agree, theta and the draws come from the same
distribution, and for any quantity q the rank

    r = #{l : q(theta_l, y) < q(theta, y)}

is uniform on 0..L. Quantities may depend on the data: the log density of the data
given a draw catches what no parameter does (Modrak et al. 2023).

What is asked of a model is a `model.SBCCase` (`Model.sbc_case`), the loop is one for all. Where
a model has sites integrated out, theta and y come from the program with them, the draws
from NUTS on the collapsed density with those sites drawn afterwards, so that the
identities behind that and all Jacobians are part of what is checked. Quantities are
identified ones.

How chains are run, and why they may start at the true values: `evaluate.sbc.chains`.
"""

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Key, PRNGKeyArray
from numpyro import handlers

from ...errors import InputError
from ...gp.linalg import AnyArray, require_finite
from ...inference.densities import require_densities
from ...inference.density import ProgramDensity
from ...model import Marginalised, Model, SBCCase
from ...programs import one_at_a_time
from ...registry import describe_model
from .chains import Chains, chain
from .controls import FAULTS, Faults, Wrong, shifted

Progress = Callable[[int], None]
SIMULATIONS, BATCH = 200, 50
# Relative difference that rounding may make between a value and itself.
SAME = 1e-10


@dataclass(frozen=True)
class _Setting:
    """All that the compiled loop depends on."""

    case: SBCCase
    chains: Chains


class _Simulation(NamedTuple):
    """What one simulation gives: true values, ranks, and how its chain went."""

    truth: dict[str, Array]
    ranks: dict[str, Array]
    autocorrelation: dict[str, Array]
    divergences: Array
    leapfrogs: Array


def calibrate(
    model: Model,
    *,
    simulations: int = SIMULATIONS,
    seed: int = 0,
    control: str = "none",
    chains: Chains | None = None,
    progress: Progress | None = None,
) -> xr.DataTree:
    """Check on simulated data that a model's posterior means what it says.

    The model is taken at a small size (`Model.sbc_case`), with its settings as they are.

    Parameters
    ----------
    model
        With its settings.
    simulations
        How often it is drawn and fitted.
    seed
        Of everything.
    control
        What is made wrong on purpose: ``none``, or one of `controls.CONTROLS`.
    chains
        How chains are run.
    progress
        Called with the simulations done.

    Returns
    -------
    As `calibrate_case`. `rank_test` says what follows, `az.plot_ecdf_pit` draws it.

    Raises
    ------
    InputError
        If the model has no density that can be drawn from, or there is no such control.
    NumericalError
        If a quantity is not finite.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> ranks = bm.calibrate(bm.Multifactor(), simulations=200)  # doctest: +SKIP
    >>> bm.rank_test(ranks)  # doctest: +SKIP
    """
    case, data = model.sbc_case()
    return calibrate_case(
        case, data, simulations=simulations, seed=seed, control=control, chains=chains,
        progress=progress,
    )  # fmt: skip


@one_at_a_time
def calibrate_case(
    case: SBCCase,
    data: Any,
    *,
    simulations: int,
    seed: int,
    control: str = "none",
    chains: Chains | None = None,
    progress: Progress | None = None,
) -> xr.DataTree:
    """Simulate, fit and rank a small model, `simulations` times.

    Parameters
    ----------
    case
        The small model.
    data
        What is not simulated, and the shape of what is.
    simulations
        How often.
    seed
        Of everything.
    control
        What is made wrong on purpose.
    chains
        How chains are run.
    progress
        Called with the simulations done.

    Returns
    -------
    Groups ``prior_sbc`` with the ranks as numbers between 0 and 1, spread evenly within
    their steps, which are uniform (for `arviz.plot_ecdf_pit`); ``ranks`` in 0..draws;
    ``prior`` with the true quantities; ``sample_stats``. One draw is one simulation.

    Raises
    ------
    InputError
        If there is no such control, or the program's density is none (`inference.densities`).
    NumericalError
        If a quantity is not finite.
    """
    if control not in FAULTS:
        raise InputError(f"control {control!r}", "there is none", f"Use {', '.join(FAULTS)}")
    began = time.perf_counter()
    program = getattr(case.model, case.program)
    require_densities(handlers.seed(program, jax.random.key(seed)), (data,))
    setting = _Setting(case, chains or Chains())
    keys = jax.random.split(jax.random.key(seed), -(-simulations // BATCH) * BATCH)
    parts = []
    for first in range(0, len(keys), BATCH):
        parts.append(
            jax.device_get(_batch(setting, FAULTS[control], data, keys[first : first + BATCH]))
        )
        if progress is not None:
            progress(min(first + BATCH, simulations))
    whole = jax.tree.map(lambda *leaves: np.concatenate(leaves)[:simulations], *parts)
    return _tree(setting, control, whole, seed, time.perf_counter() - began)


@partial(jax.jit, static_argnames="setting")
def _batch(setting: _Setting, faults: Faults, data: Any, keys: Key[Array, " n"]) -> _Simulation:
    """Run simulations side by side."""
    return jax.vmap(lambda key: _simulate(setting, faults, data, key))(keys)


def _simulate(setting: _Setting, faults: Faults, data: Any, key: PRNGKeyArray) -> _Simulation:
    """Run one simulation."""
    case = setting.case
    truth_key, shuffle_key, start_key, chain_key, rest_key, tie_key = jax.random.split(key, 6)
    truth, seen = case.draw(case.model, truth_key, data)
    late = shifted(case, data, seen)
    disordered = case.shuffle(shuffle_key, seen)
    seen = jax.tree.map(partial(jnp.where, faults.shuffle), disordered, seen)
    seen = jax.tree.map(partial(jnp.where, faults.lag), late, seen)
    wrong = Wrong(case, faults)
    density = ProgramDensity(wrong, jacobian=True)
    start = truth
    if setting.chains.start == "prior":
        start, _ = case.draw(case.model, start_key, data)
    kept, diverged, leapfrogs = chain(
        setting.chains, chain_key, density, density.real(start, (seen,)), (seen,)
    )

    def of_draw(real: dict[str, Array], key: PRNGKeyArray) -> dict[str, Array]:
        values = density.natural(real, (seen,))
        if isinstance(case.model, Marginalised):
            values = case.model.complete_draw(key, seen, values)
        return quantities(wrong, seen, values)

    keys = jax.random.split(rest_key, setting.chains.draws)
    found = jax.vmap(of_draw)(kept, keys)
    true = quantities(wrong, seen, truth)
    ranks = {
        name: _rank(key, found[name], true[name])
        for key, name in zip(jax.random.split(tie_key, len(true)), true, strict=True)
    }
    return _Simulation(
        true, ranks, jax.tree.map(_lag_one, found), jnp.sum(diverged), jnp.sum(leapfrogs)
    )


def quantities(wrong: Wrong, data: Any, values: Mapping[str, AnyArray]) -> dict[str, Array]:
    """Give what data can tell of a draw: the case's quantities, and the data's log density.

    That density is the fitted program's: given all sites but those integrated out.
    """
    sites = {name: jnp.asarray(value) for name, value in values.items()}
    trace = handlers.trace(handlers.substitute(wrong.program, data=sites)).get_trace(data)
    observed = [s for s in trace.values() if s["type"] == "sample" and s["is_observed"]]
    parts = [jnp.sum(site["fn"].log_prob(site["value"])) for site in observed]
    found = wrong.case.quantities(wrong.case.model, data, sites)
    return {**found, "log_density": jnp.sum(jnp.stack(parts))}


def _rank(key: PRNGKeyArray, draws: Array, true: Array) -> Array:
    """Count the draws (L, ...) below the true value; draws that have not moved by chance."""
    still = jnp.abs(draws - true) <= SAME * (1.0 + jnp.abs(true))
    below = jnp.sum((draws < true) & ~still, axis=0)
    return below + jax.random.randint(key, below.shape, 0, jnp.sum(still, axis=0) + 1)


def _lag_one(draws: Array) -> Array:
    """Give the autocorrelation of successive kept draws (L, ...), one where none moved."""
    centred = draws - jnp.mean(draws, axis=0)
    variance = jnp.mean(centred**2, axis=0)
    together = jnp.mean(centred[1:] * centred[:-1], axis=0)
    return jnp.where(variance > 0.0, together / jnp.where(variance > 0.0, variance, 1.0), 1.0)


def _tree(
    setting: _Setting, control: str, found: _Simulation, seed: int, seconds: float
) -> xr.DataTree:
    """Put simulations into ArviZ's form, each of them a draw."""
    require_finite(np.concatenate([v.ravel() for v in found.truth.values()]), "y")
    random = np.random.default_rng(seed)
    levels = setting.chains.draws + 1

    def spread(ranks: np.ndarray) -> np.ndarray:
        return (ranks + random.uniform(size=ranks.shape)) / levels

    groups = {
        "prior_sbc": _dataset(
            {name: spread(np.asarray(ranks)) for name, ranks in found.ranks.items()}
        ),
        "ranks": _dataset(found.ranks),
        "prior": _dataset(found.truth),
        "autocorrelation": _dataset(found.autocorrelation),
        "sample_stats": _dataset({"divergences": found.divergences, "leapfrogs": found.leapfrogs}),
    }
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = {
        "model": json.dumps(describe_model(setting.case.model)),
        "control": control,
        "chains": json.dumps(asdict(setting.chains)),
        "seed": seed,
        "seconds": seconds,
    }
    return tree


def _dataset(arrays: Mapping[str, AnyArray]) -> xr.Dataset:
    """Give arrays (simulation, ...) the dimensions chain and draw."""
    return xr.Dataset(
        {
            name: (
                ("chain", "draw", *(f"{name}_part" for _ in array.shape[1:])),
                np.asarray(array)[None],
            )
            for name, array in arrays.items()
        },
        {"chain": [0]},
    )
