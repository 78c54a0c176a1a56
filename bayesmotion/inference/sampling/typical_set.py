"""Finding out where a posterior of many unknowns has its mass, before it is sampled.

In n unknowns draws lie about sqrt(n) units from the mode, and where the density bends the
scales there are others: what is loosely told at the mode is told well among the draws, and
the other way round. Short runs from the mode go there; the mean of the Hessians at some of
their points gives the scales for runs that go on from them, and so a few times over.

The rounds find where to begin and in which units. What they draw is thrown away, and a run
that is interrupted among them begins again.
"""

from dataclasses import replace

import jax
import numpy as np
from jaxtyping import Float

from ..optimisation.optimise import flattened
from .nuts_chains import Chains, Sampler
from .rotations import rotated_to
from .whitening import (
    SampledDensity,
    SamplingProblem,
    Whitening,
    chain_starts,
    hessian_at,
    stage_key,
    transform_at,
)

ROUNDS, WARMUP, DRAWS = 3, 100, 60
# How far from the mode the first round begins, in its units: along with what bends there
# chains that begin a unit away fall into regions of their own.
NEAR = 0.01


def to_typical_set(
    problem: SamplingProblem, *, chains: int, max_tree_depth: int, seed: int
) -> tuple[SamplingProblem, Float[np.ndarray, "c m"]]:
    """Give a problem in the units of where its chains have come, and where they are.

    Parameters
    ----------
    problem
        In the units of its mode.
    chains
        How many to run; each gives two points to every mean of Hessians.
    max_tree_depth
        As in `fit_nuts`.
    seed
        Of the rounds.
    """
    key = stage_key(seed, "settling")
    z = NEAR * chain_starts(problem, key, chains, "map")
    for count in range(ROUNDS):
        sampler = Sampler(problem.target, WARMUP, "diagonal", max_tree_depth)
        keys = jax.random.split(jax.random.fold_in(key, count), chains)
        runs = Chains(sampler, problem, keys, z)
        while runs.done < WARMUP + DRAWS:
            runs.advance()
        transform = problem.transform
        drawn = (
            np.asarray(transform.mode) + runs.kept["z"][:, :DRAWS] @ np.asarray(transform.factor).T
        )
        problem, z = _moved(problem, drawn)
    return problem, z


def _moved(
    problem: SamplingProblem, drawn: Float[np.ndarray, "c d n"]
) -> tuple[SamplingProblem, Float[np.ndarray, "c m"]]:
    """Put the place in the middle of draws; give it with the last of every chain."""
    target, data = problem.target, problem.training.data
    middle = drawn.mean(axis=(0, 1))
    some = drawn[:, [drawn.shape[1] // 2, -1]].reshape(-1, drawn.shape[2])
    some = np.stack([rotated(target, u, middle) for u in some])
    hessian = np.mean([hessian_at(target, u, data) for u in some], axis=0)
    transform = transform_at(target, middle, hessian)
    last = np.stack([rotated(target, u, middle) for u in drawn[:, -1]])
    return replace(problem, transform=transform), _points(transform, last)


def rotated(target: SampledDensity, u: Float[np.ndarray, " n"], middle: np.ndarray) -> np.ndarray:
    """Turn the sites that may turn towards those of another point."""
    values: dict[str, np.ndarray] = target.unravel(np.asarray(u))
    towards = target.unravel(np.asarray(middle))
    near = {n: rotated_to(np.asarray(values[n]), np.asarray(towards[n])) for n in target.rotations}
    return flattened({**values, **near})


def _points(transform: Whitening, u: Float[np.ndarray, "c n"]) -> Float[np.ndarray, "c m"]:
    """Undo the map of a place, of points that it reaches."""
    return np.linalg.lstsq(transform.factor, (u - transform.mode).T, rcond=None)[0].T
