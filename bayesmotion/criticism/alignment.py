"""Bringing draws together that differ only in what no data can tell.

Latent points under a kernel of distances count up to an orthogonal map, components
that a model treats alike up to their order and signs, phases up to a common shift and
the direction of time. Before draws are averaged or drawn, each is moved to where it is
nearest to a reference:

    rotation      Q = argmin |X Q - R|_F over orthogonal Q, = U V^T with X^T R = U S V^T
                  (Schönemann 1966; reflections included)
    permutation   of the columns, by the largest sum of |column^T reference column|
                  (Hungarian method), each with the sign that agrees
    phases        (theta_c, step_c) -> (+-theta_c + shift, +-step_c), by the largest
                  sum of cos(theta_c + shift - reference_c)

The reference is the draws' own mean, found in a few rounds that begin with one of them.
"""

from collections.abc import Callable

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.linalg import orthogonal_procrustes
from scipy.optimize import linear_sum_assignment

from ..fit import Fit

ROUNDS = 5


def rotation_onto(
    x: Float[np.ndarray, "n q"], reference: Float[np.ndarray, "n q"]
) -> Float[np.ndarray, "q q"]:
    """Give the orthogonal map Q for which ``x @ Q`` is nearest to the reference."""
    return orthogonal_procrustes(x, reference)[0]


def permutation_onto(
    x: Float[np.ndarray, "n k"], reference: Float[np.ndarray, "n k"]
) -> tuple[np.ndarray, np.ndarray]:
    """Give the order of x's columns and their signs that bring it nearest to the reference.

    ``x[:, order] * signs`` has the reference's order.
    """
    products = reference.T @ x
    _, order = linear_sum_assignment(-np.abs(products))
    signs = np.sign(np.take_along_axis(products, order[:, None], axis=1)[:, 0])
    return order, np.where(signs == 0, 1.0, signs)


def align_rotations(draws: Float[np.ndarray, "chain draw n q"]) -> np.ndarray:
    """Turn (and reflect) every draw of latent points onto the mean of all."""
    return _aligned(draws, lambda x, reference: x @ rotation_onto(x, reference))


def align_components(draws: Float[np.ndarray, "chain draw n k"]) -> np.ndarray:
    """Order and sign the columns of every draw as in the mean of all."""

    def move(x: np.ndarray, reference: np.ndarray) -> np.ndarray:
        order, signs = permutation_onto(x, reference)
        return x[:, order] * signs

    return _aligned(draws, move)


def align_phases(
    phase: Float[np.ndarray, "chain draw c"], step: Float[np.ndarray, "chain draw c"]
) -> tuple[np.ndarray, np.ndarray]:
    """Shift the phases of all clips of a draw together, and turn time where needed.

    Parameters
    ----------
    phase
        Phase of every clip, in radians.
    step
        What it grows by in a frame, with its sign.

    Returns
    -------
    Phases from -pi to pi around the first draw's, and steps.
    """
    flat, steps = phase.reshape(-1, phase.shape[-1]), step.reshape(-1, step.shape[-1])
    reference, forward = np.exp(1j * flat[0]), steps[0]
    for _ in range(ROUNDS):
        moved = [_phase_onto(*pair, reference, forward) for pair in zip(flat, steps, strict=True)]
        flat, steps = (np.stack(parts) for parts in zip(*moved, strict=True))
        mean = np.mean(np.exp(1j * flat), axis=0)
        reference, forward = mean / np.maximum(np.abs(mean), 1e-12), steps.mean(axis=0)
    return flat.reshape(phase.shape), steps.reshape(step.shape)


def _phase_onto(
    phase: np.ndarray, step: np.ndarray, reference: np.ndarray, forward: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Move one draw's phases onto unit complex numbers; time runs as in `forward`."""
    sign = 1.0 if step @ forward >= 0.0 else -1.0
    shift = np.angle(np.sum(reference * np.exp(-1j * sign * phase)))
    away = np.angle(np.exp(1j * (sign * phase + shift)) / reference)
    return np.angle(reference) + away, sign * step


def _aligned(draws: np.ndarray, move: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> np.ndarray:
    flat = draws.reshape(-1, *draws.shape[2:])
    reference = flat[0]
    for _ in range(ROUNDS):
        flat = np.stack([move(x, reference) for x in flat])
        mean = flat.mean(axis=0)
        # Draws far apart average to less than their size, which would not hurt the map.
        reference = mean if np.any(mean) else flat[0]
    return flat.reshape(draws.shape)


def aligned(fit: Fit) -> xr.Dataset:
    """Give a fit's draws with what turns freely brought together.

    Latent paths get unit mean square, as the model sees them, and are turned; so are
    style vectors of rbf factors. Everything else is told by the data already: shapes of
    linear factors have one orientation, the first clip's phase is zero and steps are
    positive (see `models.multifactor`).
    """
    posterior = fit.tree["posterior"].to_dataset().copy()
    turning = [f"style_{f.name}" for f in fit.model.factors if f.kind == "rbf"]
    if "x" in posterior:
        size = np.sqrt((posterior["x"] ** 2).mean(("frame", "latent")))
        posterior["x"] = posterior["x"] / size
        turning.append("x")
    for name in turning:
        draws = posterior[name].transpose("chain", "draw", ...)
        posterior[name] = draws.copy(data=align_rotations(draws.values))
    return posterior
