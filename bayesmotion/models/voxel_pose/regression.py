"""Relevance vectors from features to the principal components of poses, in JAX and by search.

Basis functions are a constant and Gaussians around the features of some training frames, of a
length in medians of the distances between these features.
"""

from collections.abc import Callable
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.spatial.distance import pdist

from ...gp.linalg import AnyArray
from .relevance_vectors.data import basis_functions
from .relevance_vectors.fast import Relevant, maximise_marginal

# Lengths tried, in medians of the distances between training features.
LENGTHS = (0.5, 0.7, 1.0)
# Length in frames of the stretches held out, and how many frames at most are fitted then.
STRETCH = 12
FITTED = 700
# At most so many steps of the search, and the gain below which it takes none.
STEPS, TOLERANCE = 4000, 1.0
# Frames between which distances are looked at, at most about twice as many.
SOME = 1000
Log = Callable[[str], None]


def basis(
    x: Float[AnyArray, "n k"], centres: Float[AnyArray, "b k"], length_scale: AnyArray | float
) -> Float[Array, "n one_b"]:
    """Return the constant and the Gaussians around `centres` at features x: (N, 1 + B)."""
    centre = centres.mean(axis=0)
    x, centres = jnp.asarray(x) - centre, jnp.asarray(centres) - centre
    squared = (x**2).sum(axis=1)[:, None] + (centres**2).sum(axis=1) - 2.0 * x @ centres.T
    gaussians = jnp.exp(-0.5 * jnp.maximum(squared, 0.0) / length_scale**2)
    return jnp.concatenate([jnp.ones((len(x), 1)), gaussians], axis=1)


def median_distance(x: Float[AnyArray, "n k"]) -> Array:
    """Return the median distance between frames' features (of many, between some of them)."""
    some = jnp.asarray(x)[:: max(1, len(x) // SOME)]
    first, second = np.triu_indices(len(some), 1)
    squared = (some**2).sum(axis=1)
    apart = squared[:, None] + squared - 2.0 * some @ some.T
    return jnp.sqrt(jnp.maximum(jnp.median(apart[first, second]), 1e-12))


def candidates(frames: int, most: int) -> Int[np.ndarray, " b"]:
    """Return the numbers of at most so many frames, evenly chosen."""
    return np.arange(frames)[:: -(-frames // most)]


@dataclass(frozen=True)
class Found:
    """What the search found.

    length
        Of the Gaussians, in medians of distances.
    length_scale
        The same in units of the features.
    centres
        (B,) numbers of the frames with basis functions.
    relevant
        The bases kept, the constant being number 0.
    held_out
        (P,) mean squared errors of the outputs on frames held out.
    """

    length: float
    length_scale: float
    centres: Int[np.ndarray, " b"]
    relevant: Relevant
    held_out: Float[np.ndarray, " p"]


def search(
    x: Float[np.ndarray, "n k"],
    z: Float[np.ndarray, "n p"],
    sd: Float[np.ndarray, " p"],
    *,
    length: float | None,
    least_noise: float,
    most: int,
    log: Log | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> Found:
    """Find the relevance vectors from features to outputs of unit variance.

    Every other stretch of the frames is held out to choose the length, unless it is given,
    and to learn how far off predictions are.

    Parameters
    ----------
    x, z
        Features and outputs of the frames, NaN where an output is missing.
    sd
        Of the outputs in the poses' units, by which their errors count.
    length
        Of the Gaussians, in medians of distances; None for that of `LENGTHS` which does best.
    least_noise
        Variance that an output's noise is at least.
    most
        At most so many frames, evenly chosen, have basis functions to choose from.
    log
        Called with a line after every stage.
    progress
        Called with the last search's steps and its log marginal likelihood.
    """
    errors = {}
    for one in LENGTHS if length is None else (length,):
        errors[one] = _held_out(x, z, one, least_noise)
        if log is not None:
            share = float(errors[one] @ sd**2 / (sd**2).sum())
            log(f"length {one:g}: {100 * share:.1f} % of the variance missed where held out")
    best = min(errors, key=lambda one: float(errors[one] @ sd**2))
    length_scale = best * _median(x)
    centres = candidates(len(x), most)
    phi = basis_functions(x, x[centres], length_scale)
    relevant = _search(phi, z, least_noise, progress)
    if log is not None:
        end = "converged" if relevant.converged else "not converged"
        log(
            f"length {best:g}: log marginal likelihood {relevant.log_marginal:.0f}, "
            f"{len(relevant.kept)} of {len(x)} kept, {end} after {relevant.steps} steps"
        )
    return Found(best, length_scale, centres, relevant, errors[best])


def _median(x: np.ndarray) -> float:
    return float(np.median(pdist(x[:: max(1, len(x) // SOME)])))


def _search(
    phi: np.ndarray,
    z: np.ndarray,
    least_noise: float,
    progress: Callable[[int, float], None] | None = None,
) -> Relevant:
    return maximise_marginal(
        phi, z, least_noise=least_noise, max_steps=STEPS, tolerance=TOLERANCE, progress=progress
    )


def _held_out(x: np.ndarray, z: np.ndarray, length: float, least_noise: float) -> np.ndarray:
    """Return the mean squared error of every output on every other stretch of the frames."""
    stretch = min(STRETCH, max(1, len(x) // 4))
    held = np.arange(len(x)) // stretch % 2 == 1
    fitted = np.flatnonzero(~held)
    fitted = fitted[:: max(1, round(len(fitted) / FITTED))]
    length_scale = length * _median(x)
    phi = basis_functions(x[fitted], x[fitted], length_scale)
    relevant = _search(phi, z[fitted], least_noise)
    phi = basis_functions(x[held], x[fitted], length_scale)[:, relevant.kept]
    return np.nanmean((relevant.predict(phi)[0] - z[held]) ** 2, axis=0)
