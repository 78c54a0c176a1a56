"""Leaving out what a user would want predicted: a limb, a clip, the future.

Left out is a block B of the training data. For a draw theta of everything unknown

    p(y_B | y_-B, theta)

is exact (`gp.leave_out`). Given draws from the posterior of all data, importance
sampling with the ratios 1 / p(y_B | y_-B, theta) turns them into draws from that without
B; where the Pareto k of a block says that this does not work, or the fit is a point
estimate, the model is fitted again without the block. Pareto k is 0 then.

Scores are log densities of angular features in radians. Their velocities are left out
with them and are not scored: they are differences of the angles and would count them
twice.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from arviz_stats.utils import ELPDDataLOO
from jaxtyping import Array, Float
from scipy.special import logsumexp
from scipy.stats import norm

from ..errors import InputError
from ..fit import Fit
from ..gp.leave_out import leave_out_blocks, normal_log_density
from ..gp.linalg import AnyArray
from ..models.multifactor import Multifactor
from ..models.poses import Frames, clip_labels, frames_of
from ..motion.dataset import clips, skeleton_of
from ..motion.joining import concat, split
from ..priors.dynamics import roll_out
from ..tasks.forecast import forecast, truth
from .draws import stacked, unstacked
from .limbs import limb_features, limbs
from .loo import SAMPLE, elpd, pareto_smoothed, seen_entries_of

Refit = Callable[[xr.Dataset], Fit]


class Blocks(NamedTuple):
    """F blocks to leave out.

    rows
        (F, N) 1 where a frame is left out.
    columns
        (F, D) 1 where a feature is scored.
    """

    rows: Float[np.ndarray, "f n"]
    columns: Float[np.ndarray, "f d"]


def leave_limbs_out(
    fit: Fit, refit: Refit, *, most: int | None = None, only: Sequence[str] | None = None
) -> ELPDDataLOO:
    """Score each limb of each clip, given the clip's other limbs and all other clips.

    Parameters
    ----------
    fit
        The fit.
    refit
        Fits the same model in the same way to other clips; called for a limb of a clip
        where importance sampling does not work.
    most
        Use so many draws at most.
    only
        Names of the limbs (their first joints); all where None.

    Returns
    -------
    One point a limb of a clip, its joint log density, with ``clip`` and ``limb``.

    Raises
    ------
    InputError
        If there is no such limb.
    """
    training, layout = fit.training, fit.training.encoding.layout
    known = limbs(skeleton_of(next(iter(split(fit.motion).values()))), layout)
    for name in only or ():
        if name not in known:
            raise InputError(f"limb {name!r}", "there is none", f"Use some of {', '.join(known)}")
    cases = [(clip, limb) for clip in training.clips for limb in (only or known)]
    clip_of = np.asarray(training.clips)[np.asarray(training.frames.clip)]
    rows = np.stack([clip_of == clip for clip, _ in cases]).astype(float)
    columns = np.zeros((len(cases), len(layout.labels)))
    for case, (_, limb) in zip(columns, cases, strict=True):
        case[limb_features(layout, known[limb])] = 1.0
    columns[:, layout.n_angles :] = 0.0

    def again(case: int) -> float:
        clip, limb = cases[case]
        other = refit(without_limb(fit.motion, clip, known[limb]))
        whole = complete_frames(other, fit.motion)
        here = Blocks(rows[case : case + 1], columns[case : case + 1])
        values, _ = stacked(other, most)
        return _mean_density(_joint(other, whole, values, here)[:, 0])

    values, shape = stacked(fit, most)
    joint = _joint(fit, training.frames, values, Blocks(rows, columns))
    density, k_hat = _sampled_or(again, joint, shape)
    coords = {
        "clip": ("point", np.array([clip for clip, _ in cases])),
        "limb": ("point", np.array([limb for _, limb in cases])),
    }
    return _result(density, k_hat, coords, shape)


def leave_clips_out(
    fit: Fit, refit: Refit, *, lengths: Mapping[str, tuple[int, int]], max_steps: int = 400
) -> ELPDDataLOO:
    """Fit without each clip, and score its frames by a forecast from its first ones.

    The clip's own unknowns (its styles where no other clip has them, phase and step, or
    path) are estimated from the frames given, as for any new clip. They belong to the
    clip, so draws that have seen all of it are no draws without it, and every clip is
    left out by a fit of its own.

    Parameters
    ----------
    fit
        The fit.
    refit
        As in `leave_limbs_out`.
    lengths
        For each clip to leave out the numbers of frames given and predicted.
    max_steps
        Of the search for the clip's unknowns.

    Returns
    -------
    One point a predicted frame: the sum over the angular features of the log predictive
    densities, in radians; with ``clip`` and ``frame`` (within the clip).

    Raises
    ------
    InputError
        If a clip is not there or too short, or is the only one.
    """
    parts = split(fit.motion)
    scores: list[np.ndarray] = []
    for clip, (given, horizon) in lengths.items():
        if clip not in parts or len(parts) < 2 or parts[clip].sizes["frame"] < given + horizon:
            raise InputError(
                f"clip {clip!r}",
                f"it cannot be left out and predicted from frame {given} to {given + horizon}",
                "Name training clips that are long enough, of at least two",
            )
        others = concat([part for name, part in parts.items() if name != clip])
        scores.append(forecast_score(refit(others), parts[clip], given, horizon, max_steps))
    coords = {
        "clip": ("point", np.repeat(list(lengths), [len(score) for score in scores])),
        "frame": ("point", np.concatenate([g + np.arange(h) for g, h in lengths.values()])),
    }
    points = xr.DataArray(np.concatenate(scores), dims="point", coords=coords)
    return elpd(points, n_samples=fit.tree["posterior"].sizes["draw"])


def forecast_score(
    fit: Fit, clip: xr.Dataset, given: int, horizon: int, max_steps: int = 400
) -> Float[np.ndarray, " h"]:
    """Log density of each frame's angles (radians) under a clip's forecast."""
    predicted = forecast(fit, clip, given=given, horizon=horizon, max_steps=max_steps)
    true = truth(fit, clip, given, horizon)
    assert true is not None
    n = fit.training.encoding.n_angles
    mean, sd = predicted.mean[given:, :n], predicted.sd[given:, :n]
    return np.nansum(norm.logpdf(true[:, :n], mean, sd), axis=1)


def leave_future_out(
    fit: Fit, refit: Refit, *, horizon: int, most: int | None = None
) -> ELPDDataLOO:
    """Score the last `horizon` frames of every clip, given all that came before.

    Phases and paths go on by the dynamics: a phase at its step, a path by the mean of
    what follows.

    Parameters
    ----------
    fit, refit, most
        As in `leave_limbs_out`; all clips' ends are one block.
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
    training = fit.training
    sizes = np.bincount(np.asarray(training.frames.clip))
    if horizon < 1 or sizes.min() < horizon + 2:
        raise InputError(
            f"horizon {horizon}",
            f"the shortest clip has {sizes.min()} frames",
            "Leave at least one frame out and keep at least two",
        )
    place = np.concatenate([np.arange(size) for size in sizes])
    future = place >= sizes[np.asarray(training.frames.clip)] - horizon
    columns = np.arange(len(training.encoding.layout.labels)) < training.encoding.n_angles
    block = Blocks(future[None].astype(float), columns[None].astype(float))
    values, shape = stacked(fit, most)
    density, k_hat = None, np.zeros(1)
    if shape[0] * shape[1] > 1:
        K = partial(fit.model.covariance, training.frames)
        frame, joint = _frames_of_block(fit, training.frames, values, block, K)
        smoothed = pareto_smoothed(_tree(unstacked(joint[:, None], shape)))
        k_hat = np.asarray(smoothed.pareto_k.values)
        if k_hat[0] <= smoothed.good_k:
            weights = smoothed.log_weights.transpose(*SAMPLE, ...).values.reshape(-1, 1)
            density = logsumexp(frame[:, future] + weights, axis=0)
    if density is None:
        density, k_hat = _future_again(fit, refit, horizon, block, most), np.zeros(1)
    clip = np.asarray(training.clips)[np.asarray(training.frames.clip)]
    coords = {"clip": ("point", clip[future]), "frame": ("point", place[future])}
    return _result(density, np.repeat(k_hat, future.sum()), coords, shape)


def _future_again(
    fit: Fit, refit: Refit, horizon: int, block: Blocks, most: int | None
) -> np.ndarray:
    """Fit without the ends of all clips, and score them."""
    short = {c: p.isel(frame=slice(None, -horizon)) for c, p in split(fit.motion).items()}
    other = refit(concat(list(short.values())))
    whole = complete_frames(other, fit.motion, short)
    values, _ = stacked(other, most)
    K = partial(_going_on, other.model, other.training.frames, whole, horizon)
    frame, _ = _frames_of_block(other, whole, values, block, K)
    return logsumexp(frame[:, block.rows[0] > 0], axis=0) - np.log(len(frame))


def _going_on(
    model: Multifactor, past: Frames, whole: Frames, horizon: int, draw: Mapping[str, Array]
) -> AnyArray:
    """Covariance of all frames of clips of which a fit has seen the beginning."""
    given = model.given(past, draw)
    points = {
        factor.name: given.styles[factor.name][whole.level[factor.name]][whole.clip]
        for factor in model.factors
    }
    if given.steps is None:
        content = model.points(whole, draw)["content"]
    else:
        x, clip = given.points["content"], np.asarray(past.clip)
        paths = [np.flatnonzero(clip == c) for c in range(past.n_clips)]
        content = jnp.concatenate(
            [roll_out(given.steps, x[rows], len(rows) + horizon) for rows in paths]
        )
    return model.covariance(whole, draw, {**points, "content": content})


def without_limb(motion: xr.Dataset, clip: str, joints: tuple[str, ...]) -> xr.Dataset:
    """Give clips with the angles of some joints of one clip missing."""
    owner = np.array([str(dof).split("/")[0] for dof in motion["dof"].values])
    hidden = np.outer(motion["clip"].values == clip, np.isin(owner, joints))
    return motion.assign(angle=motion["angle"].where(~hidden))


def complete_frames(
    fit: Fit, motion: xr.Dataset, seen: Mapping[str, xr.Dataset] | None = None
) -> Frames:
    """Give clips in the units of a fit that has seen less of the same clips.

    Parameters
    ----------
    fit
        The fit.
    motion
        The clips as they are.
    seen
        The part of each clip that the fit has seen, where that is its beginning; time
        and heading are that part's.
    """
    encoding, levels = fit.training.encoding, fit.training.levels
    labels = {factor: clip_labels(motion, factor) for factor in levels}
    parts = split(motion)
    scaled = {
        clip: encoding.scaled(encoding.features(part, encoding.heading((seen or parts)[clip])))
        for clip, part in parts.items()
    }
    frames = frames_of(scaled, labels, levels)
    if seen is None:
        return frames
    middle = {clip: (part.sizes["frame"] - 1) / 2.0 for clip, part in seen.items()}
    time = [np.arange(parts[c].sizes["frame"]) - middle[c] for c in clips(motion)]
    return dataclasses.replace(frames, time=np.concatenate(time))


def _log_spread(fit: Fit, frames: Frames, blocks: Blocks) -> np.ndarray:
    """Logarithm of the units of what is scored in each block (F,)."""
    seen = seen_entries_of(frames)
    return np.einsum(
        "fn,nd,fd,d->f", blocks.rows, seen, blocks.columns, np.log(fit.training.encoding.spread)
    )


def _joint(fit: Fit, frames: Frames, values: Mapping[str, Array], blocks: Blocks) -> np.ndarray:
    """Log density (S, F) in radians of each block given the rest, draw by draw."""
    density = _block_densities(fit.model, frames, dict(values), blocks)
    return np.asarray(density) - _log_spread(fit, frames, blocks)


@partial(jax.jit, static_argnames="model")
def _block_densities(
    model: Multifactor, frames: Frames, values: dict[str, Array], blocks: Blocks
) -> Array:
    def one(draw: dict[str, Array]) -> Array:
        K = model.covariance(frames, draw)
        left = leave_out_blocks(
            jnp.asarray(frames.y), K, draw["scale"], frames.missing, jnp.asarray(blocks.rows)
        )
        return jnp.sum(left.log_density * blocks.columns, axis=1)

    return jax.lax.map(one, values)


def _frames_of_block(
    fit: Fit,
    frames: Frames,
    values: Mapping[str, Array],
    block: Blocks,
    covariance: Callable[[Mapping[str, Array]], AnyArray],
) -> tuple[np.ndarray, np.ndarray]:
    """Log densities in radians of each frame (S, N) of one block, and of all of it (S,)."""
    y, seen = jnp.asarray(frames.y), jnp.asarray(seen_entries_of(frames))
    counted = seen * block.columns[0]

    @jax.jit
    def every(values: dict[str, Array]) -> tuple[Array, Array]:
        def one(draw: dict[str, Array]) -> tuple[Array, Array]:
            left = leave_out_blocks(
                y, covariance(draw), draw["scale"], frames.missing, jnp.asarray(block.rows)
            )
            each = normal_log_density(y, left.mean[0], left.variance[0])
            frame = jnp.sum(jnp.where(counted > 0, each, 0.0), axis=1)
            return frame, jnp.sum(left.log_density[0] * block.columns[0])

        return jax.lax.map(one, values)

    frame, joint = every(dict(values))
    units = np.asarray(counted) @ np.log(fit.training.encoding.spread)
    return np.asarray(frame) - units, np.asarray(joint) - _log_spread(fit, frames, block)[0]


def _sampled_or(
    again: Callable[[int], float], joint: np.ndarray, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray]:
    """Give each block's log density and Pareto k, by a new fit where sampling fails."""
    count = joint.shape[1]
    if len(joint) == 1:
        return np.array([again(case) for case in range(count)]), np.zeros(count)
    smoothed = pareto_smoothed(_tree(unstacked(joint, shape)))
    density, k_hat = smoothed.elpd_i.values.copy(), smoothed.pareto_k.values.copy()
    for case in np.flatnonzero(~(k_hat <= smoothed.good_k)):
        density[case], k_hat[case] = again(int(case)), 0.0
    return density, k_hat


def _mean_density(densities: np.ndarray) -> float:
    """Logarithm of the mean over draws."""
    return float(logsumexp(densities) - np.log(len(densities)))


def _tree(densities: np.ndarray) -> xr.DataTree:
    """Put log densities (chain, draw, point) where ArviZ looks for them."""
    likelihood = xr.Dataset({"y": ((*SAMPLE, "point"), densities)})
    posterior = xr.Dataset({"density": (SAMPLE, densities.sum(axis=2))})
    return xr.DataTree.from_dict({"posterior": posterior, "log_likelihood": likelihood})


def _result(density, k_hat, coords, shape) -> ELPDDataLOO:
    points = xr.DataArray(density, dims="point", coords=coords)
    return elpd(
        points, n_samples=shape[0] * shape[1], k_hat=xr.DataArray(k_hat, points.coords, ["point"])
    )
