"""The no-U-turn sampler (Hoffman and Gelman 2014) for any model of the collection.

Chains begin around the mode and move on the whitened unknowns of `sampling`, so that
the mass matrix that is adapted on top begins with the right units and correlations.
Each chain is a thread of its own: JAX lets go of the interpreter while it computes.

A run goes block by block, and after every block its whole state can be written to a
checkpoint. A run that is killed and resumed gives the same draws, to the last bit on
the same machine, as one that was left alone.
"""

import os
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array
from numpyro import infer  # noqa: F401 (the whole before a part of it)
from numpyro.infer.hmc import hmc

from ..fit import Fit
from ..models.registry import Model, describe_model
from .checkpoint import Checkpoint, fingerprint
from .mode import Progress
from .results import Record, make_fit
from .sampling import Place, Problem, Start, Target, chain_starts, pose, stage_key

BLOCK = 20
TARGET_ACCEPT = 0.8

Mass = Literal["dense", "diagonal"]


@dataclass(frozen=True)
class Sampler:
    """NUTS on one target; equal samplers share a compilation.

    warmup
        Iterations in which step size and mass matrix are adapted.
    mass
        Whether the mass matrix adapted in z is dense.
    max_tree_depth
        A trajectory has at most 2^max_tree_depth - 1 leapfrog steps.
    """

    target: Target
    warmup: int
    mass: Mass
    max_tree_depth: int

    def begin(self, key: Array, z: Array, place: Place, data: tuple) -> Any:
        """Give the state of a chain that begins at z (n,)."""
        return _compiled(self)[0](key, z, place, data)

    def block(self, state: Any, place: Place, data: tuple) -> tuple[Any, dict[str, Array]]:
        """Go on by `BLOCK` iterations; give the state, and points and figures (block, ...)."""
        return _compiled(self)[1](state, place, data)


@lru_cache(maxsize=8)
def _compiled(sampler: Sampler) -> tuple[Any, Any]:
    """Compile how a chain begins and goes on by a block."""

    def potential(place: Place, data: tuple) -> Any:
        return lambda z: -sampler.target(z, place, data)

    init, move = hmc(potential_fn_gen=potential, algo="NUTS")

    def begin(key, z, place, data):
        return init(
            z,
            num_warmup=sampler.warmup,
            dense_mass=sampler.mass == "dense",
            target_accept_prob=TARGET_ACCEPT,
            max_tree_depth=sampler.max_tree_depth,
            model_args=(place, data),
            rng_key=key,
        )

    def step(state, place, data):
        state = move(state, (place, data), {})
        return state, {
            "z": state.z,
            "lp": -state.potential_energy,
            "energy": state.energy,
            "diverging": state.diverging,
            "n_steps": state.num_steps,
            "acceptance_rate": state.accept_prob,
            "step_size": state.adapt_state.step_size,
        }

    def block(state, place, data):
        return jax.lax.scan(lambda s, _: step(s, place, data), state, length=BLOCK)

    return jax.jit(begin), jax.jit(block)


class Chains:
    """Chains of a sampler that go on together, block by block.

    done
        Iterations so far.
    kept
        Points and figures after the warm-up, (chain, draws so far, ...).
    """

    def __init__(self, sampler: Sampler, problem: Problem, keys: Array, z: np.ndarray) -> None:
        self._sampler, self._where = sampler, (problem.place, problem.training.data)
        self._states = [
            sampler.begin(key, jnp.asarray(one), *self._where)
            for key, one in zip(keys, z, strict=True)
        ]
        self._threads = min(len(z), os.cpu_count() or 1)
        self.done = 0
        self.kept: dict[str, np.ndarray] = {}

    def advance(self) -> None:
        """Go on by a block in every chain."""

        def one(state: Any) -> Any:
            return jax.block_until_ready(self._sampler.block(state, *self._where))

        with ThreadPoolExecutor(self._threads) as pool:
            moved = list(pool.map(one, self._states))
        self._states = [state for state, _ in moved]
        drop = min(max(self._sampler.warmup - self.done, 0), BLOCK)
        self.done += BLOCK
        for name in moved[0][1]:
            new = np.stack([np.asarray(figures[name]) for _, figures in moved])[:, drop:]
            past = self.kept.get(name)
            self.kept[name] = new if past is None else np.concatenate([past, new], axis=1)

    @property
    def best(self) -> float:
        """The best log density of where the chains are."""
        return float(-min(state.potential_energy for state in self._states))

    def arrays(self) -> dict[str, np.ndarray]:
        """Give everything that is needed to go on from here."""
        leaves = [jax.tree.leaves(state) for state in self._states]
        states = {
            f"state_{i}": np.stack(parts) for i, parts in enumerate(zip(*leaves, strict=True))
        }
        kept = {f"kept_{name}": value for name, value in self.kept.items()}
        return {"done": np.array(self.done), **states, **kept}

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Undo `arrays`."""
        for chain, state in enumerate(self._states):
            leaves, structure = jax.tree.flatten(state)
            saved = [jnp.asarray(arrays[f"state_{i}"][chain]) for i in range(len(leaves))]
            self._states[chain] = jax.tree.unflatten(structure, saved)
        self.done = int(arrays["done"])
        prefix = "kept_"
        self.kept = {n.removeprefix(prefix): v for n, v in arrays.items() if n.startswith(prefix)}


def fit_nuts(
    model: Model,
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
    preparation: Mapping[str, Any] | None = None,
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
        ``map`` begins around the mode, in the scales of the Hessian there; ``prior``
        begins at draws of the prior, and the adaptation alone finds the scales.
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
        File for the state after every block of 20 iterations; none where None. It is
        left there: who has saved the fit may delete it.
    resume
        Go on from the checkpoint if there is one; else begin anew.
    preparation
        Keywords of the model's `prepare`, which makes clips into features.
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
    preparation = dict(preparation or {})
    training = model.prepare(motion, **preparation)
    settings = {"warmup": warmup, "chains": chains, "start": start, "mass": mass}
    settings |= {"max_tree_depth": max_tree_depth, "integrate": integrate}
    run = {"inference": "nuts", "seed": seed, "preparation": preparation, **settings}
    path = None if checkpoint is None else Path(checkpoint)
    part = Checkpoint(path, fingerprint(describe_model(model), run, training.data))
    saved = part.load() if resume else None
    problem = pose(model, training, seed, start, integrate, saved)
    sampler = Sampler(problem.target, warmup, mass, max_tree_depth)
    keys = jax.random.split(stage_key(seed, "chains"), chains)
    begin = chain_starts(problem, stage_key(seed, "starts"), chains, start)
    runs = Chains(sampler, problem, keys, begin)
    before = 0.0
    if saved is not None:
        runs.restore(saved)
        before = float(saved["seconds"])
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
    record = Record("nuts", {**settings, "draws": draws}, preparation, seed, seconds, told)
    return make_fit(model, motion, training, values, stats, record)


def _stats(kept: Mapping[str, np.ndarray], max_tree_depth: int) -> dict[str, np.ndarray]:
    """Give a sampler's figures the names ArviZ has for them."""
    depth = np.floor(np.log2(np.maximum(kept["n_steps"], 1))).astype(int) + 1
    return {**kept, "tree_depth": depth, "reached_max_treedepth": depth >= max_tree_depth}


def _warnings(problem: Problem, stats: Mapping[str, np.ndarray]) -> list[str]:
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
    if not problem.converged:
        said.append("the search for the mode that the chains began around has not converged")
    return said
