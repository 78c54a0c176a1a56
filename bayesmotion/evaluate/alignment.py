"""Bringing draws together that differ only in what no data can tell.

Latent points under a kernel of distances count up to an orthogonal map, components
that a model treats alike up to their order, phases up to a common shift and the direction
of time. Before draws are averaged or drawn, each is moved to where it is
nearest to a reference:

    rotation      Q = argmin |X Q - R|_F over orthogonal Q, = U V^T with X^T R = U S V^T
                  (Schönemann 1966; reflections included)
    permutation   of the components, by the least sum of squared differences from the
                  reference's (Hungarian method)
    phases        (theta_c, step_c) -> (+-theta_c + shift, +-step_c), by the largest
                  sum of cos(theta_c + shift - reference_c)

The reference is the draws' own mean, found in a few rounds that begin with one of them.
Which sites of a model count up to which of these its verbs say (`model.RotationInvariant`,
`ScaleInvariant`, `PermutationInvariant`, `PhaseInvariant`).
"""

from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.linalg import orthogonal_procrustes
from scipy.optimize import linear_sum_assignment

from ..fit import Fit
from ..model import PermutationInvariant, PhaseInvariant, RotationInvariant, ScaleInvariant

ROUNDS = 5


def rotation_onto(
    x: Float[np.ndarray, "n q"], reference: Float[np.ndarray, "n q"]
) -> Float[np.ndarray, "q q"]:
    """Return the orthogonal map Q for which ``x @ Q`` is nearest to the reference."""
    return orthogonal_procrustes(x, reference)[0]


def align_rotations(draws: Float[np.ndarray, "chain draw n q"]) -> np.ndarray:
    """Rotate (and reflect) every draw of latent points onto the mean of all."""
    return _aligned(draws, lambda x, reference: x @ rotation_onto(x, reference))


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


def align_permutations(
    draws: Mapping[str, np.ndarray],
    axes: Mapping[str, tuple[int, ...]],
    rotated: tuple[str, ...] = (),
) -> dict[str, np.ndarray]:
    """Order the components of every draw, of all sites together, as in the mean of all.

    Parameters
    ----------
    draws
        Sites (chain, draw, ...).
    axes
        Of each site the axes, counted after chain and draw, that count the components.
    rotated
        Sites of which each component counts up to a rotation: their inner products are
        compared.

    Returns
    -------
    The sites, with the order that brings their components nearest to the mean (least
    squares, every site in units of its standard deviation over draws and components). What
    counts is sites with a single such axis; the others are ordered along.
    """
    shape = next(iter(draws.values())).shape[:2]
    flat = {name: value.reshape(-1, *value.shape[2:]) for name, value in draws.items()}
    told = [name for name in axes if len(axes[name]) == 1] or list(axes)
    parts = [_by_component(flat[name], axes[name][0], name in rotated) for name in told]
    features = np.concatenate(parts, axis=2)
    orders = np.tile(np.arange(features.shape[1]), (len(features), 1))
    reference = features[0]
    for _ in range(ROUNDS):
        away = features[:, None] - reference[None, :, None]
        cost = np.einsum("srkf,srkf->srk", away, away)
        orders = np.stack([linear_sum_assignment(one)[1] for one in cost])
        reference = np.take_along_axis(features, orders[:, :, None], axis=1).mean(axis=0)
    out = {}
    for name, value in flat.items():
        moved = value
        for axis in axes[name]:
            index = orders.reshape(len(orders), *(-1 if a == axis else 1
                                                  for a in range(value.ndim - 1)))  # fmt: skip
            moved = np.take_along_axis(moved, index, axis=axis + 1)
        out[name] = moved.reshape(*shape, *value.shape[1:])
    return out


def _by_component(draws: np.ndarray, axis: int, rotated: bool) -> Float[np.ndarray, "s k f"]:
    """Return what draws (S, ...) say of every component, in standard deviations."""
    parts = np.moveaxis(draws, axis + 1, 1)
    if rotated:
        parts = np.einsum("...ij,...kj->...ik", parts, parts)
    rows = parts.reshape(*parts.shape[:2], -1)
    sd = rows.std(axis=(0, 1))
    return rows / np.where(sd > 0.0, sd, 1.0)


def aligned(fit: Fit) -> xr.Dataset:
    """Return a fit's draws with what differs only by a symmetry of the model brought together.

    Sites that count up to their size get unit mean square, components are put in one order,
    latent points are rotated, and phases are shifted. Sites of a model that says nothing of
    symmetries come back as they are.

    Raises
    ------
    KeyError
        If the model names a site that its fit does not have.
    """
    model = fit.model
    posterior = fit.tree["posterior"].to_dataset().copy()
    sample = ("chain", "draw")
    draws = {str(n): v.transpose(*sample, ...).values for n, v in posterior.data_vars.items()}
    if isinstance(model, ScaleInvariant):
        for name in model.free_scales:
            draws[name] = draws[name] / _size(draws[name])
    rotations = model.rotations if isinstance(model, RotationInvariant) else ()
    if isinstance(model, PermutationInvariant):
        for axes in model.permutations:
            draws |= align_permutations({name: draws[name] for name in axes}, axes, rotations)
    for name in rotations:
        draws[name] = _rotated(draws[name])
    if isinstance(model, PhaseInvariant):
        for phase, step in model.phases:
            draws[phase], draws[step] = align_phases(draws[phase], draws[step])
    for name, value in draws.items():
        turned = posterior[name].transpose(*sample, ...)
        posterior[name] = turned.copy(data=value)
    return posterior


def _size(draws: np.ndarray) -> np.ndarray:
    """Root mean square of every draw (chain, draw, ...)."""
    return np.sqrt(np.mean(draws**2, axis=tuple(range(2, draws.ndim)), keepdims=True))


def _rotated(draws: np.ndarray) -> np.ndarray:
    """Rotate draws (chain, draw, N, Q), or of every component (chain, draw, K, N, Q)."""
    if draws.ndim == 4:
        return align_rotations(draws)
    return np.stack([align_rotations(draws[:, :, k]) for k in range(draws.shape[2])], axis=2)
