"""Ensemble sampling of a whole model of few unknowns; see `walkers` for the moves.

The ensemble is one chain: a fit's draws are the points of all walkers at steps that are
far apart, under one chain number. What they are worth is told by the autocorrelation
time: attributes ``ess`` (site by site, the smallest over its entries), ``autocorrelation``
and ``acceptance``. No R-hat is to be had of such a fit.
"""

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, get_args

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from ...errors import InputError
from ...fit import Fit
from ...model import Fittable
from ..checkpoint import Checkpoint
from ..optimisation.mode import Progress
from ..results import Record, make_fit
from .walkers import (
    LENGTHS,
    Ensemble,
    EnsembleRun,
    EnsembleState,
    Steps,
    random_arrays,
    random_state,
    together,
)
from .whitening import SamplingProblem, chain_starts, sampling_problem, stage_key

BLOCK = 20


EnsembleStart = Literal["map", "prior"]


def fit_ensemble(
    model: Fittable,
    motion: xr.Dataset,
    *,
    warmup: int = 1000,
    steps: int = 2000,
    draws: int = 2000,
    walkers: int | None = None,
    seed: int = 0,
    start: EnsembleStart = "map",
    checkpoint: str | Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> Fit:
    """Fit a model of few unknowns by an ensemble of walkers.

    Parameters
    ----------
    model
        The model with its settings; its priors must be proper.
    motion
        Training clips with a text label for each factor of the model.
    warmup, steps
        Steps of the ensemble that are thrown away, and that draws are taken from.
    draws
        How many of the points are kept.
    walkers
        An even number; three for each unknown where None.
    seed, start, checkpoint, resume, progress
        As in `inference.sampling.nuts.fit_nuts`.

    Raises
    ------
    InputError
        If the model has too many unknowns, the clips do not fit together, the
        checkpoint is of another run, or there is no such start.
    NumericalError
        If no start has a finite log density.
    """
    began = time.perf_counter()
    if draws > steps * (walkers or draws):
        raise InputError("ensemble", f"{draws} draws are more than there are points", "Ask less")
    if start not in get_args(EnsembleStart):
        raise InputError(f"start {start!r}", "walkers have no such", "Use 'map' or 'prior'")
    training = model.prepare(motion)
    settings = {"warmup": warmup, "walkers": walkers, "start": start}
    run = {"inference": "ensemble", "seed": seed, **settings}
    part = Checkpoint.of(checkpoint, model, training, run)
    saved = part.load() if resume else None
    before = 0.0 if saved is None else float(saved["seconds"])
    problem = sampling_problem(model, training, seed, start, found=saved)
    if saved is None:
        # The search for the mode can take most of the time: it is kept at once.
        part.save({**problem.arrays(), "seconds": np.array(time.perf_counter() - began)})
    count = walkers or 3 * problem.unknowns + problem.unknowns % 2
    ensemble = EnsembleRun(problem.log_density, (count, problem.unknowns))
    if saved is None or "done" not in saved:
        begin = chain_starts(problem, stage_key(seed, "starts"), count, start)
        # emcee's own random numbers are seeded by a number, drawn from the stage's key.
        state, blocks, done = ensemble.begin(begin, _number(seed)), [], 0
    else:
        state, blocks, done = _restored(saved)
    while done < warmup + steps:
        state, block = ensemble.advance(state, BLOCK)
        drop = min(max(warmup - done, 0), BLOCK)
        blocks.append(Steps(*(figures[drop:] for figures in block)))
        done += BLOCK
        seconds = np.array(before + time.perf_counter() - began)
        part.save({**_arrays(state, blocks, done), **problem.arrays(), "seconds": seconds})
        if progress is not None:
            progress(min(done, warmup + steps), float(state.log_density.max()))
    found = together([Steps(*(figures[:steps] for figures in _joined(blocks)))])
    values = problem.values(stage_key(seed, "integrated out"), found.draws(draws)[None])
    lp = found.log_density.reshape(-1)[found.places(draws)][None]
    settings |= {"walkers": count, "steps": steps, "draws": draws}
    seconds = before + time.perf_counter() - began
    told = _warnings(problem, found)
    record = Record("ensemble", settings, seed, seconds, told, _worth(problem, found))
    return make_fit(model, motion, training, values, {"lp": lp}, record)


def _number(seed: int) -> int:
    return int(jax.random.randint(stage_key(seed, "walkers"), (), 0, 2**31 - 1))


def _joined(blocks: list[Steps]) -> Steps:
    return Steps(*(np.concatenate(parts) for parts in zip(*blocks, strict=True)))


def _arrays(state: EnsembleState, blocks: list[Steps], done: int) -> dict[str, np.ndarray]:
    """Give everything that is needed to go on."""
    now = {"walkers": state.walkers, "walkers_lp": state.log_density}
    kept = {f"kept_{name}": value for name, value in _joined(blocks)._asdict().items()}
    return {"done": np.array(done), **now, **random_arrays(state.random), **kept}


def _restored(saved: Mapping[str, np.ndarray]) -> tuple[EnsembleState, list[Steps], int]:
    """Undo `_arrays`."""
    state = EnsembleState(saved["walkers"], saved["walkers_lp"], random_state(saved))
    kept = Steps(*(saved[f"kept_{name}"] for name in Steps._fields))
    return state, [kept], int(saved["done"])


def _worth(problem: SamplingProblem, found: Ensemble) -> dict[str, Any]:
    """Give the figures of the run: acceptance, and for every site the worst of its entries."""
    tau = problem.target.unravel(jnp.asarray(found.autocorrelation))
    points = found.values.shape[0] * found.values.shape[1]
    # A site may have no entries: the shape of a factor of one level.
    worst = {name: float(np.max(value)) for name, value in tau.items() if value.size}
    return {
        "acceptance": found.acceptance,
        "autocorrelation": json.dumps(worst),
        "ess": json.dumps({name: points / value for name, value in worst.items()}),
    }


def _warnings(problem: SamplingProblem, found: Ensemble) -> list[str]:
    said = []
    if not found.trusted:
        said.append(
            f"the run of {len(found.values)} steps is shorter than {LENGTHS} autocorrelation "
            f"times of {float(np.max(found.autocorrelation)):.0f}: give more steps"
        )
    if not problem.converged:
        said.append("the search for the mode that the walkers began around has not converged")
    return said
