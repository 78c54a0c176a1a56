"""Saying so where a forecast is of nobody the model knows, or of no body at all.

A model trained on few people goes on, sure of itself, where it knows nothing. Each of these is
one `MotionWarning`: the pace found lies outside that of the training clips; the style is unlike
every trained one; the body forecast sinks below where the clip's frames stood; joints bend as
in no training clip.
"""

import warnings
from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import MotionWarning
from ..fit import Fit
from ..models.poses import Frames
from ..motion.dataset import skeleton_of
from ..motion.kinematics import poses, positions

# A pace may be this many times the fastest trained one, or the slowest by it.
PACE = 1.1
# Prior correlation of a style with the most similar trained one, the content being the same,
# and how many times their prior spread is.
LEAST_ALIKE, MOST_SPREAD = 0.5, 2.0
# Body heights that the lowest joint may sink below the lowest of the frames given.
SINKS = 0.05
# Of the range of an angle in training, and radians, that it may go beyond it.
BEYOND, BEYOND_RADIANS = 0.5, 0.1
NAMED = 3


def warn_of_forecast(
    fit: Fit,
    frames: Frames,
    values: Mapping[str, np.ndarray],
    mean: Float[np.ndarray, "n d"],
    motion: xr.Dataset,
    given: int,
) -> None:
    """Warn, in a line each, of what is not to be believed of a forecast.

    Parameters
    ----------
    fit
        The fit.
    frames, values
        The frames given and the clip's sites.
    mean
        (given + horizon, D) predicted features in their own units.
    motion
        The same as a Motion.
    given
        Number of frames given.
    """
    told = [*_pace(fit, values), *_style(fit, frames, values)]
    told += [*_floor(motion, given), *_joints(fit, mean[given:])]
    for sentence in told:
        warnings.warn(f"the forecast: {sentence}", MotionWarning, stacklevel=3)


def _pace(fit: Fit, values: Mapping[str, np.ndarray]) -> Iterator[str]:
    if fit.model.dynamics != "circle":
        return
    a_second = fit.training.encoding.frame_rate / (2.0 * np.pi)
    pace, trained = float(values["step"][0]) * a_second, fit.values()["step"] * a_second
    if not trained.min() / PACE <= pace <= trained.max() * PACE:
        yield (
            f"its pace of {pace:.2f} cycles a second lies outside that of the training clips, "
            f"{trained.min():.2f} to {trained.max():.2f}"
        )


def _style(fit: Fit, frames: Frames, values: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Compare as the kernel does: it sees no rotation, sign or common length of vectors."""
    model = fit.model
    if not any(f"style_{factor.name}" in values for factor in model.factors):
        return
    names = [factor.name for factor in model.factors]
    own, known = model.points(frames, values, fit.trained), fit.trained.points
    firsts = np.asarray(fit.training.frames.steps.first)
    places = {name: np.asarray(own[name])[:1] for name in names}
    trained = {name: np.asarray(known[name])[firsts] for name in names}
    size = np.asarray(own["content"]).shape[1]
    places["content"], trained["content"] = np.zeros((1, size)), np.zeros((len(firsts), size))
    kernel = model.kernel(fit.trained.hyper)
    variance = float(np.asarray(kernel.matrix(places, places))[0, 0])
    variances = np.diagonal(np.asarray(kernel.matrix(trained, trained)))
    alike = np.asarray(kernel.matrix(places, trained))[0] / np.sqrt(variance * variances)
    low, high = np.sqrt(variances.min()) / MOST_SPREAD, np.sqrt(variances.max()) * MOST_SPREAD
    if alike.max() < LEAST_ALIKE:
        yield (
            "its style is unlike that of every training clip: "
            f"the most similar correlates by {alike.max():.2f}"
        )
    if not low <= np.sqrt(variance) <= high:
        yield (
            f"its style vectors are {np.sqrt(variance / np.median(variances)):.2f} times as long "
            "as is usual among the training clips"
        )


def _floor(motion: xr.Dataset, given: int) -> Iterator[str]:
    low = positions(motion).sel(space="y").values.min(axis=1)
    skeleton = skeleton_of(motion)
    rest, _ = poses(skeleton, np.zeros((1, len(skeleton.dofs))), np.zeros((1, 3)))
    height = float(np.ptp(rest[0], axis=0).max())
    before, after = low[:given][np.isfinite(low[:given])], low[given:]
    if len(before) and (sunk := float(before.min() - after.min()) / height) > SINKS:
        yield f"the body sinks {sunk:.0%} of its height below where the frames given stood"


def _joints(fit: Fit, mean: Float[np.ndarray, "h d"]) -> Iterator[str]:
    encoding, n = fit.training.encoding, fit.training.encoding.n_angles
    trained = fit.training.observed()["y"].values
    angles = encoding.unscaled(trained)[:, :n]
    low, high = np.nanmin(angles, axis=0), np.nanmax(angles, axis=0)
    room = BEYOND * (high - low) + BEYOND_RADIANS
    over = np.maximum(low - mean[:, :n], mean[:, :n] - high).max(axis=0)
    out = [i for i in np.argsort(room - over) if over[i] > room[i]]
    if out:
        names = [f"{encoding.layout.labels[i]} by {over[i]:.1f} rad" for i in out[:NAMED]]
        more = f" and {len(out) - NAMED} more" if len(out) > NAMED else ""
        yield f"joints bend farther than in training: {', '.join(names)}{more}"
