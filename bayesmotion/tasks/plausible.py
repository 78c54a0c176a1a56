"""What is not to be believed of a forecast: it is of nobody the model knows, or of no body at all.

Each is a sentence: what the model says itself of the clip (`model.TellsNovelty`: a pace or
a style unlike every trained one); the body forecast sinks below where the clip's context
frames stood; joints bend as in no training clip.
"""

from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float

from ..fit import Fit
from ..inference.draws import stacked
from ..inference.predicting import Prediction, require_model
from ..model import AngleData, TellsNovelty
from ..motion.dataset import skeleton_of
from ..motion.kinematics import poses, positions

# Body heights that the lowest joint may sink below the lowest of the context frames.
SINKS = 0.05
# Of the range of an angle in training, and radians, that it may go beyond it.
BEYOND, BEYOND_RADIANS = 0.5, 0.1
NAMED = 3


def doubts(
    fit: Fit,
    prediction: Prediction,
    draws: int,
    mean: Float[np.ndarray, "n d"],
    motion: xr.Dataset,
    context: int,
) -> list[str]:
    """Return, in a sentence each, what is not to be believed of a forecast.

    Parameters
    ----------
    fit
        The fit.
    prediction
        Of the clip, by at most `draws` draws of the fit.
    draws
        As in `predict`.
    mean
        (context + horizon, D) predicted features in their own units.
    motion
        The same as a Motion.
    context
        Number of context frames.
    """
    told = [*_novelty(fit, prediction, draws)]
    return [*told, *sinking(motion, context), *bending(fit, mean[context:])]


def _novelty(fit: Fit, prediction: Prediction, draws: int) -> list[str]:
    """Ask the model of the component of most weight."""
    model = fit.model
    if not isinstance(model, TellsNovelty):
        return []
    best = int(np.argmax(prediction.weight))
    values, _ = stacked(fit, draws)
    at = {name: jnp.asarray(value[prediction.draw[best]]) for name, value in values.items()}
    own = {name: value[best] for name, value in prediction.unknowns.items()}
    trained = require_model(fit).condition(fit.training.data[0], at)
    return model.novelty(trained, prediction.data.data[0], own)


def sinking(motion: xr.Dataset, context: int) -> Iterator[str]:
    """Tell of a body that sinks below where the context frames stood."""
    low = positions(motion).sel(space="y").values.min(axis=1)
    skeleton = skeleton_of(motion)
    rest, _ = poses(skeleton, np.zeros((1, len(skeleton.dofs))), np.zeros((1, 3)))
    height = float(np.ptp(rest[0], axis=0).max())
    before, after = low[:context][np.isfinite(low[:context])], low[context:]
    if len(before) and (sunk := float(before.min() - after.min()) / height) > SINKS:
        yield f"the body sinks {sunk:.0%} of its height below where the context frames stood"


def bending(fit: Fit, mean: Float[np.ndarray, "h d"]) -> Iterator[str]:
    """Tell of joints that bend farther than in any training clip; `mean` in units of its own."""
    training = fit.training
    if not isinstance(training, AngleData):
        return
    ((name, observed),) = training.observed().data_vars.items()
    units = training.units()[str(name)]
    seen = np.isfinite(observed.values).any(axis=0)
    columns = np.asarray(training.angles)
    columns = columns[seen[columns]]
    angles = units.natural(observed.values)[:, columns]
    low, high = np.nanmin(angles, axis=0), np.nanmax(angles, axis=0)
    room = BEYOND * (high - low) + BEYOND_RADIANS
    ahead = mean[:, columns]
    over = np.maximum(low - ahead, ahead - high).max(axis=0)
    out = [i for i in np.argsort(room - over) if over[i] > room[i]]
    if out:
        labels = observed[observed.dims[1]].values[columns]
        names = [f"{labels[i]} by {over[i]:.1f} rad" for i in out[:NAMED]]
        more = f" and {len(out) - NAMED} more" if len(out) > NAMED else ""
        yield f"joints bend farther than in training: {', '.join(names)}{more}"
