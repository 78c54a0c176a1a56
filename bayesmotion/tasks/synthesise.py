"""Synthesis: motions nobody recorded, from a model with circle dynamics.

A motion is a path of styles and phases: the styles of any combination of
levels (a missing cell of the grid), styles drawn from a Gaussian fitted to the
learned ones, or gaits that change along a line. The step of the phase comes
from a bilinear map of the styles, fitted to the training clips' steps (Wang,
Fleet and Hertzmann 2007, section 4.2); poses are the trained process's mean.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import InputError
from ..fit import Fit
from ..models.multifactor import circle
from ..motion.dataset import skeletons
from ..motion.joining import split
from ..motion.kinematics import positions

Styles = dict[str, Float[np.ndarray, "n s"]]


@dataclass(frozen=True)
class Synthesis:
    """A synthesised motion.

    motion
        The Motion, on the floor.
    styles
        For each factor the style vector of every frame.
    phase
        (N,) phase of every frame in radians, running on.
    sd
        (N, D) standard deviation of the features in their own units.
    """

    motion: xr.Dataset
    styles: Styles
    phase: Float[np.ndarray, " n"]
    sd: Float[np.ndarray, "n d"]


def learned_style(fit: Fit, factor: str, level: str) -> Float[np.ndarray, " s"]:
    """Give the learned style vector of a level.

    Raises
    ------
    InputError
        If the model has no such factor or level.
    """
    levels = fit.training.levels
    if factor not in levels or level not in levels[factor]:
        known = ", ".join(levels.get(factor, [])) or "none"
        raise InputError(
            "synthesis", f"{factor} {level!r} is not in the training clips", f"Known: {known}"
        )
    return fit.values()[f"style_{factor}"][levels[factor].index(level)]


def sampled_style(fit: Fit, factor: str, seed: int) -> Float[np.ndarray, " s"]:
    """Draw a style vector from the Gaussian with the learned vectors' mean and covariance."""
    learned = fit.values()[f"style_{factor}"]
    mean = learned.mean(axis=0)
    spread = (learned - mean) / np.sqrt(max(len(learned) - 1, 1))
    white = np.random.default_rng(seed).normal(size=len(learned))
    return mean + white @ spread


def step_map(fit: Fit) -> Float[np.ndarray, "..."]:
    """Fit the multilinear map from style vectors to the step, one axis a factor.

    Least squares over the training clips; of all maps that fit equally well the
    one of the smallest norm.
    """
    values, frames = fit.values(), fit.training.frames
    features = np.ones((frames.n_clips, 1))
    sizes = []
    for factor in fit.model.factors:
        style = values[f"style_{factor.name}"][np.asarray(frames.level[factor.name])]
        features = (features[:, :, None] * style[:, None, :]).reshape(frames.n_clips, -1)
        sizes.append(factor.size)
    weights = np.linalg.pinv(features) @ values["step"]
    return weights.reshape(sizes) if sizes else weights


def synthesise(
    fit: Fit,
    styles: Styles,
    *,
    clip: str,
    skeleton: str | None = None,
    phase: float = 0.0,
    labels: dict[str, str] | None = None,
) -> Synthesis:
    """Make the motion of a path of styles.

    Parameters
    ----------
    fit
        A fit with circle dynamics.
    styles
        For each factor the style vector of every frame (N, S), N at least 2.
    clip
        Name of the new clip.
    skeleton
        Name of the training skeleton that moves; the first one where None.
    phase
        Phase of the first frame, in radians.
    labels
        Labels of the new clip.

    Raises
    ------
    InputError
        If the dynamics are not the circle's, a factor is missing, or the step that
        follows from the styles is not positive.
    """
    model, given = fit.model, fit.trained
    if model.dynamics != "circle":
        raise InputError(
            "synthesis", f"the fit has {model.dynamics} dynamics", "Fit with --dynamics circle"
        )
    lacking = [factor.name for factor in model.factors if factor.name not in styles]
    if lacking:
        raise InputError("synthesis", f"no style for {', '.join(lacking)}", "Give every factor")
    for factor in model.factors:
        if styles[factor.name].shape[1] != factor.size:
            raise InputError(
                f"styles of {factor.name!r}",
                f"they have {styles[factor.name].shape[1]} entries, trained ones {factor.size}",
                "Leave out spare entries: synthesis is of what is known",
            )
    angle = _phases(fit, styles, phase)
    points = {factor.name: factor.padded(styles[factor.name]) for factor in model.factors}
    points["content"] = jnp.asarray(circle(jnp.asarray(angle)))
    kernel = model.kernel(given.hyper)
    mean, covariance = given.conditioned(
        kernel.matrix(points, given.points), kernel.matrix(points, points)
    )
    encoding = fit.training.encoding
    variance = jnp.diagonal(covariance, axis1=1, axis2=2) + 1.0 / given.hyper["beta"]
    columns = np.asarray(given.conditioned.missing.columns)
    sd = np.sqrt(np.einsum("pn,pd->nd", variance, columns)) / np.asarray(given.hyper["scale"])
    bodies = skeletons(fit.motion)
    body = bodies[skeleton] if skeleton is not None else next(iter(bodies.values()))
    y = encoding.scaled(_level(encoding.unscaled(np.asarray(mean))))
    motion = encoding.motion(
        y, body, clip=clip, start=np.zeros(3), labels=labels, source="synthesised"
    )
    return Synthesis(_on_floor(motion), styles, angle, sd * encoding.spread)


def cell(fit: Fit, levels: dict[str, str], seconds: float, *, phase: float = 0.0) -> Synthesis:
    """Make the motion of one combination of levels, recorded or not."""
    n = _frames(fit, seconds)
    styles = {
        factor.name: np.tile(learned_style(fit, factor.name, levels.get(factor.name, "")), (n, 1))
        for factor in fit.model.factors
    }
    name = "-".join(levels.values())
    return synthesise(
        fit, styles, clip=name, skeleton=_skeleton_with(fit, levels), phase=phase, labels=levels
    )


def transition(
    fit: Fit,
    levels: dict[str, str],
    factor: str,
    path: tuple[str, ...],
    seconds: float,
) -> Synthesis:
    """Move one factor along straight lines through the levels of `path`, in equal times.

    levels
        The levels of the other factors, which stay.
    """
    n = _frames(fit, seconds)
    corners = np.stack([learned_style(fit, factor, level) for level in path])
    where = np.linspace(0.0, len(path) - 1.0, n)
    moving = np.stack(
        [np.interp(where, np.arange(len(path)), corner) for corner in corners.T], axis=1
    )
    styles = {
        other.name: np.tile(learned_style(fit, other.name, levels[other.name]), (n, 1))
        for other in fit.model.factors
        if other.name != factor
    }
    skeleton = _skeleton_with(fit, levels)
    name = f"{'-'.join(levels.values())}: {' to '.join(path)}"
    return synthesise(fit, {**styles, factor: moving}, clip=name, skeleton=skeleton, labels=levels)


def sampled(fit: Fit, seconds: float, seed: int) -> Synthesis:
    """Make a motion with every factor's style drawn from the learned ones' Gaussian."""
    n = _frames(fit, seconds)
    styles = {
        factor.name: np.tile(sampled_style(fit, factor.name, 1000 * seed + index), (n, 1))
        for index, factor in enumerate(fit.model.factors)
    }
    return synthesise(fit, styles, clip=f"sample {seed}")


def _frames(fit: Fit, seconds: float) -> int:
    n = round(seconds * fit.training.encoding.frame_rate)
    if n < 2:
        raise InputError("synthesis", f"{seconds} seconds are {n} frames", "Ask for more")
    return n


def _phases(fit: Fit, styles: Styles, phase: float) -> Float[np.ndarray, " n"]:
    weights = step_map(fit)
    step = np.broadcast_to(weights, (len(next(iter(styles.values()))), *weights.shape))
    for factor in fit.model.factors:
        step = np.einsum("ns...,ns->n...", step, styles[factor.name])
    if not np.all(step > 0):
        raise InputError(
            "synthesis",
            f"the styles lead to a step of {step.min():.3f} radians a frame",
            "Choose styles nearer to the learned ones",
        )
    return phase + np.concatenate([[0.0], np.cumsum(step[:-1])])


def _level(features: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
    """Take out the mean climb: the root's height is a sum of velocities, and drifts."""
    out = features.copy()
    out[:, -2] -= out[1:, -2].mean()
    return out


def _on_floor(motion: xr.Dataset) -> xr.Dataset:
    """Put the lowest joint of the motion at height zero."""
    lowest = float(positions(motion).sel(space="y").min())
    root = motion["root_position"].copy()
    root.loc[{"space": "y"}] -= lowest
    return motion.assign(root_position=root)


def _skeleton_with(fit: Fit, levels: dict[str, str]) -> str | None:
    """Name the skeleton of a training clip with the subject asked for."""
    for part in split(fit.motion).values():
        if "subject" in levels and part["subject"].values[0] == levels["subject"]:
            return str(part["skeleton"].values[0])
    return None
