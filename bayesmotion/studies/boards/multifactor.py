"""The multifactor model on a board of channels: every training clip is a take with its own style.

The content is a circle whose pace is learned, and the one style factor is ``take``, whose levels
are the clips: a clip to forecast is a take that nobody knows. It is fitted and forecast by the
public verbs.

Outputs are independent in the model, but channels of a body deviate from its cycle together. So
channels are turned into the principal axes of what the training clips have beside their own Fourier
series (`residual_axes`), in which these deviations are uncorrelated, and forecasts back again.
"""

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ...errors import MotionWarning
from ...fit import Fit
from ...inference.methods import MAP, fit
from ...models.multifactor import Circle, Factor, Multifactor
from ...prediction import Mixture
from ...programs import forget_programs
from ...tasks.forecast import forecast
from ..fits import multifactor_of
from .baselines import cycles_of, waves
from .channels import channel_motion
from .harness import Board, Clips, Method, clip_scores

FACTOR = "take"


class View(NamedTuple):
    """How new takes are seen by a fit: settings that the fit itself does not depend on.

    new_levels, novel_dims
        Of `Factor`.
    wander_sd
        Of `Circle`.
    context_weight
        Of `Multifactor`.
    """

    new_levels: str = "population"
    novel_dims: int = 0
    wander_sd: float = 0.0
    context_weight: float = 1.0


def take_model(size: int, view: View) -> Multifactor:
    """Return the model with style vectors of a size."""
    return seen_by(Multifactor(factors=(Factor(FACTOR, size),), align_heading=False,
                               lengths="file"), view)  # fmt: skip


def seen_by(model: Multifactor, view: View) -> Multifactor:
    """Return a model that sees new takes by a view."""
    changed: dict[str, Any] = {"new_levels": view.new_levels, "novel_dims": view.novel_dims}
    factors = tuple(replace(factor, **changed) for factor in model.style_factors)
    content = Circle("learned", view.wander_sd)
    return replace(model, factors=factors, content=content, context_weight=view.context_weight)


class Taught(NamedTuple):
    """A fit, and the axes (D, D) that channels are turned into, columns."""

    fit: Fit
    axes: Float[np.ndarray, "d d"]


def residual_axes(clips: Clips, frame_rate: float) -> Float[np.ndarray, "d d"]:
    """Return the principal axes, columns, of training clips about their own Fourier series."""
    cycles = cycles_of(clips, frame_rate)
    rest = np.concatenate([
        clip - waves(2.0 * np.pi * np.arange(len(clip)) / period + phase) @ own
        for clip, own, period, phase in zip(
            clips.values(), cycles.weights, cycles.period, cycles.phase, strict=True
        )
    ])  # fmt: skip
    return np.linalg.eigh(rest.T @ rest)[1]


def train(clips: Clips, frame_rate: float, model: Multifactor, max_steps: int, seed: int) -> Taught:
    """Fit the model to training clips by its mode."""
    labels = {name: {FACTOR: name} for name in clips}
    axes = residual_axes(clips, frame_rate)
    turned = {name: clip @ axes for name, clip in clips.items()}
    motion = channel_motion(turned, frame_rate, labels)
    with warnings.catch_warnings():
        # Whether it has converged stands in the results.
        warnings.simplefilter("ignore", MotionWarning)
        method = MAP(initial=2, keep=1, max_steps=max_steps)
        return Taught(fit(model, motion, method=method, seed=seed), axes)


def method_of(taught: Taught, frame_rate: float, view: View | None = None) -> Method:
    """Return the forecast of a fit, in degrees, as boards ask for it."""
    found = taught.fit
    if view is not None:
        model, _ = multifactor_of(found)
        found = replace(found, model=seen_by(model, view))

    def method(context: np.ndarray, horizon: int) -> Mixture:
        clip = channel_motion({"clip": context @ taught.axes}, frame_rate)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MotionWarning)
            told = forecast(found, clip, context=len(context), horizon=horizon)
        labels = list(told.prediction.data.observed()["feature"].values)
        columns = np.array([labels.index(f"c{i:02d}/rx") for i in range(context.shape[1])])
        ahead = told.mixture.part(slice(len(context), None), columns)
        return turned_back(ahead, taught.axes)

    return method


def turned_back(told: Mixture, axes: Float[np.ndarray, "d d"]) -> Mixture:
    """Return a forecast of channels in degrees, of that of their axes in radians."""
    variance = (np.degrees(told.sd) ** 2) @ (axes**2).T
    return Mixture(np.degrees(told.mean) @ axes.T, np.sqrt(variance), told.weight)


def folds_of(clips: Clips, count: int) -> Iterator[tuple[Clips, Clips]]:
    """Give training clips and those left out together: every `count`-th, so that all are once."""
    names = list(clips)
    for first in range(count):
        left = names[first::count]
        yield {n: c for n, c in clips.items() if n not in left}, {n: clips[n] for n in left}


def left_out(
    board: Board,
    size: int,
    views: Mapping[str, View],
    *,
    folds: int,
    max_steps: int,
    seed: int,
    say: Any = print,
) -> dict[str, dict[str, dict[str, float]]]:
    """Return scores {view: {clip: ...}} of training clips, by fits to the clips of other folds."""
    found: dict[str, dict[str, dict[str, float]]] = {name: {} for name in views}
    for others, left in folds_of(board.train, folds):
        forget_programs()
        apart = replace(board, train=others, test=left)
        one = train(others, board.frame_rate, take_model(size, View()), max_steps, seed)
        for name, view in views.items():
            method = method_of(one, board.frame_rate, view)
            for clip, y in left.items():
                told = method(y[: board.context].copy(), apart.horizon(clip))
                found[name][clip] = clip_scores(apart, clip, told)
        say(f"{', '.join(left)} left out: "
            + ", ".join(f"{name} {np.mean([each[c]['mse'] for c in left]):.2f}"
                        for name, each in found.items()))  # fmt: skip
    return found
