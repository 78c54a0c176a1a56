"""The no-U-turn sampler (Hoffman and Gelman 2014) for any model of the collection.

Chains move on the whitened unknowns of `sampling`, so that the mass matrix that is adapted
on top begins with the right units and correlations.

A run goes block by block (`nuts_chains`), and after every block its whole state can be
written to a checkpoint. A run that is killed and resumed gives the same draws, to the
last bit on the same machine, as one that was left alone.
"""

import time
from collections.abc import Mapping
from pathlib import Path

import jax
import numpy as np
import xarray as xr
from numpyro import diagnostics

from ...fit import Fit
from ...model import Fittable
from ..checkpoint import Checkpoint
from ..optimisation.mode import Progress
from ..results import Record, make_fit
from .nuts_chains import Chains, Mass, Sampler
from .typical_set import to_typical_set
from .whitening import SamplingProblem, Start, chain_starts, sampling_problem, stage_key

# R-hat of the log density above which chains are told to be unlike each other.
UNLIKE = 1.05


def fit_nuts(
    model: Fittable,
    motion: xr.Dataset,
    *,
    warmup: int = 500,
    draws: int = 500,
    chains: int = 4,
    seed: int = 0,
    start: Start = "map",
    mass: Mass = "diagonal",
    max_tree_depth: int = 10,
    integrate: bool = True,
    checkpoint: str | Path | None = None,
    resume: bool = False,
    progress: Progress | None = None,
) -> Fit:
    """Fit a model by draws from its posterior.

    Parameters
    ----------
    model
        The model with its settings; its priors must be proper.
    motion
        Training clips with a text label for each factor of the model.
    warmup, draws, chains
        Iterations of each chain that adapt the sampler, and that are kept.
    seed
        The one seed.
    start
        ``map`` begins around the mode, in the scales of the Hessian there; ``typical``
        goes from the mode to where the draws are, and takes the scales from there
        (`typical_set`): for hundreds of unknowns; ``prior`` begins at draws of the prior, and
        the adaptation alone finds the scales.
    mass
        Mass matrix that is adapted on top: ``diagonal``, which leaves correlations to
        the whitening at the mode, or ``dense``. The first windows of the warm-up hold 25
        and 50 draws: of more unknowns than that a dense matrix is nearly singular, and
        trees run to their limit.
    max_tree_depth
        At most 2^max_tree_depth - 1 leapfrog steps an iteration.
    integrate
        Whether to integrate out what the model can (`Multifactor`: the scales) and to
        draw it again afterwards, or to sample it with the rest.
    checkpoint
        File for the mode, once it is found, and the state after every block of 20 iterations;
        none where None. It is left there: who has saved the fit may delete it.
    resume
        Go on from the checkpoint if there is one; else begin anew.
    progress
        Called with the iterations done and the best log density.

    Raises
    ------
    InputError
        If the clips do not fit together, a prior is improper, or the checkpoint is of
        another run.
    NumericalError
        If no start has a finite log density.
    """
    began = time.perf_counter()
    training = model.prepare(motion)
    settings = {"warmup": warmup, "chains": chains, "start": start, "mass": mass}
    settings |= {"max_tree_depth": max_tree_depth, "integrate": integrate}
    run = {"inference": "nuts", "seed": seed, **settings}
    part = Checkpoint.of(checkpoint, model, training, run)
    saved = part.load() if resume else None
    before = 0.0 if saved is None else float(saved["seconds"])
    problem = sampling_problem(model, training, seed, start, integrate, saved)
    if saved is None:
        # The search for the mode can take most of the time: it is kept at once.
        part.save({**problem.arrays(), "seconds": np.array(time.perf_counter() - began)})
    under_way = saved is not None and "done" in saved
    if under_way:
        begin = np.zeros((chains, problem.unknowns))  # where they are is in the checkpoint
    elif start == "typical":
        problem, begin = to_typical_set(
            problem, chains=chains, max_tree_depth=max_tree_depth, seed=seed
        )
    else:
        begin = chain_starts(problem, stage_key(seed, "starts"), chains, start)
    sampler = Sampler(problem.target, warmup, mass, max_tree_depth)
    keys = jax.random.split(stage_key(seed, "chains"), chains)
    runs = Chains(sampler, problem, keys, begin)
    if saved is not None and under_way:
        runs.restore(saved)
    while runs.done < warmup + draws:
        runs.advance()
        seconds = np.array(before + time.perf_counter() - began)
        part.save({**runs.arrays(), **problem.arrays(), "seconds": seconds})
        if progress is not None:
            progress(min(runs.done, warmup + draws), runs.best)
    kept = {name: value[:, :draws] for name, value in runs.kept.items()}
    values = problem.values(stage_key(seed, "integrated out"), kept.pop("z"))
    stats = _stats(kept, max_tree_depth)
    seconds = before + time.perf_counter() - began
    told = _warnings(problem, stats)
    record = Record("nuts", {**settings, "draws": draws}, seed, seconds, told)
    return make_fit(model, motion, training, values, stats, record)


def _stats(kept: Mapping[str, np.ndarray], max_tree_depth: int) -> dict[str, np.ndarray]:
    """Give a sampler's figures the names ArviZ has for them."""
    depth = np.floor(np.log2(np.maximum(kept["n_steps"], 1))).astype(int) + 1
    return {**kept, "tree_depth": depth, "reached_max_treedepth": depth >= max_tree_depth}


def _warnings(problem: SamplingProblem, stats: Mapping[str, np.ndarray]) -> list[str]:
    """Say what to know before trusting the draws."""
    said = []
    total = stats["diverging"].size
    diverging, deep = int(stats["diverging"].sum()), int(stats["reached_max_treedepth"].sum())
    if diverging:
        said.append(
            f"{diverging} of {total} iterations diverged: the draws may miss a narrow part of "
            "the posterior"
        )
    if deep:
        said.append(
            f"{deep} of {total} iterations reached the largest tree: the chains move slowly; "
            "give a larger max_tree_depth"
        )
    chains, draws = stats["lp"].shape
    if draws >= 4 and (r_hat := _r_hat(stats["lp"])) > UNLIKE:
        said.append(
            f"R-hat of the log density is {r_hat:.2f} over {chains} chains of {draws} draws: they "
            "are not of one posterior yet; run longer"
        )
    if not problem.converged:
        said.append("the search for the mode, where the run began, has not converged")
    return said


def _r_hat(draws: np.ndarray) -> float:
    """Return R-hat of half chains (chain, draw), infinite where they stand still apart."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found = float(diagnostics.split_gelman_rubin(draws))
    return found if np.isfinite(found) else float("inf")
