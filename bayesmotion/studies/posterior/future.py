"""Leaving out how every clip ends: does a model know how a motion goes on?"""

from collections.abc import Mapping
from functools import partial

import jax.numpy as jnp
import numpy as np
from arviz_stats.utils import ELPDDataLOO
from jaxtyping import Array
from scipy.special import logsumexp

from ...distributions.dynamics import roll_out
from ...errors import InputError
from ...fit import Fit
from ...gp.linalg import AnyArray
from ...inference.draws import stacked
from ...models.multifactor import Multifactor
from ...models.multifactor.frames import Frames
from ...motion.joining import concat, split
from ..fits import multifactor_of
from .blocks import Blocks, Refit, complete_frames, frame_densities, result, without


def leave_future_out(
    fit: Fit, refit: Refit, *, horizon: int, most: int | None = None
) -> ELPDDataLOO:
    """Score the last `horizon` frames of every clip, given all that came before.

    Phases and paths go on by the dynamics: a phase at its step, a path by the mean of
    what follows.

    Parameters
    ----------
    fit
        The fit.
    refit
        Fits the same model in the same way to other clips; called for a point estimate, and
        where importance sampling does not work.
    most
        Use so many draws at most. All clips' ends are one block.
    horizon
        Number of frames that are left out of each clip.

    Returns
    -------
    One point a frame, with ``clip`` and ``frame`` (within the clip).

    Raises
    ------
    InputError
        If a clip has not at least two frames more than that.
    """
    model, training = multifactor_of(fit)
    sizes = np.bincount(np.asarray(training.frames.clip))
    if horizon < 1 or sizes.min() < horizon + 2:
        raise InputError(
            f"horizon {horizon}",
            f"the shortest clip has {sizes.min()} frames",
            "Leave at least one frame out and keep at least two",
        )
    place = np.concatenate([np.arange(size) for size in sizes])
    future = place >= sizes[np.asarray(training.frames.clip)] - horizon
    features = np.arange(len(training.encoding.layout.labels))
    angles = (features < training.encoding.n_angles).astype(float)
    block = Blocks(future[None].astype(float), np.ones_like(angles)[None], angles[None])
    values, shape = stacked(fit, most)
    density, k_hat = None, 0.0
    if shape[0] * shape[1] > 1:
        K = partial(model.covariance, training.frames)
        frame, left = frame_densities(training, training.frames, values, block, K)
        weights = without(left[:, None], shape)
        if weights.k_hat[0] <= weights.good_k:
            density = np.asarray(logsumexp(frame[:, future] + weights.log, axis=0))
            k_hat = float(weights.k_hat[0])
    if density is None:
        density = _future_again(fit, refit, horizon, block, most)
    clip = np.asarray(training.clips)[np.asarray(training.frames.clip)]
    coords = {"clip": ("point", clip[future]), "frame": ("point", place[future])}
    return result(density, np.full(len(density), k_hat), coords, shape[0] * shape[1])


def _future_again(
    fit: Fit, refit: Refit, horizon: int, block: Blocks, most: int | None
) -> np.ndarray:
    """Fit without the ends of all clips, and score them."""
    short = {c: p.isel(frame=slice(None, -horizon)) for c, p in split(fit.motion).items()}
    other = refit(concat(list(short.values())))
    model, training = multifactor_of(other)
    whole = complete_frames(training, fit.motion, short)
    values, _ = stacked(other, most)
    K = partial(_going_on, model, training.frames, whole, horizon)
    frame, _ = frame_densities(training, whole, values, block, K)
    return np.asarray(logsumexp(frame[:, block.rows[0] > 0], axis=0)) - np.log(len(frame))


def _going_on(
    model: Multifactor, past: Frames, whole: Frames, horizon: int, draw: Mapping[str, Array]
) -> AnyArray:
    """Covariance of all frames of clips of which a fit has seen the beginning."""
    trained = model.condition(past, draw)
    points = {
        factor.name: trained.styles[factor.name][whole.level[factor.name]][whole.clip]
        for factor in model.style_factors
    }
    if trained.steps is None:
        content = model.latent_points(whole, draw)["content"]
    else:
        x, clip = trained.points["content"], np.asarray(past.clip)
        paths = [np.flatnonzero(clip == c) for c in range(past.n_clips)]
        content = jnp.concatenate(
            [roll_out(trained.steps, x[rows], len(rows) + horizon) for rows in paths]
        )
    return model.covariance(whole, draw, {**points, "content": content})
