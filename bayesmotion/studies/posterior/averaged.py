"""Forecast averaged over the posterior: over the trained model's draws and the clip's own.

For each of some draws of the trained model the new clip's unknowns are sampled by NUTS
given that draw, and every pair of draws gives every entry of the frames to come a normal
distribution, conditioned on the training frames and on the context frames. The forecast
is the mixture of them: what the mode alone predicts, and how unsure it is of the mode.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr

from ...fit import Fit
from ...inference.draws import stacked
from ...inference.sampling.whitening import SamplingProblem, stage_key
from ...models.multifactor.frames import Frames
from ...motion.joining import lengthened
from ...prediction import Mixture
from ...tasks.forecast import context_of
from ...tasks.outcome import OfMixture
from ..fits import multifactor_of
from .clips import ClipData, clip_problem, clip_values, sample_nuts

COMPONENTS, TRAINED = 64, 16
WARMUP, DRAWS = 100, 40
THREADS = 2
# What forecasts that are kept depend on.
SETTINGS = {"components": COMPONENTS, "trained": TRAINED, "warmup": WARMUP, "draws": DRAWS}


@dataclass(frozen=True)
class PosteriorForecast(OfMixture):
    """A forecast of one clip, averaged over draws.

    mixture
        Predicted features (context + horizon, D) in their own units, a normal distribution
        for every pair of draws.
    values
        The new clip's sites, (trained draw, draw, ...) each.
    context, horizon
        Numbers of frames.
    """

    mixture: Mixture
    values: dict[str, np.ndarray]
    context: int
    horizon: int


def forecast_posterior(
    fit: Fit,
    motion: xr.Dataset,
    *,
    context: int,
    horizon: int,
    seed: int,
    labels: dict[str, str] | None = None,
    trained: int = TRAINED,
    warmup: int = WARMUP,
    draws: int = DRAWS,
    components: int = COMPONENTS,
) -> PosteriorForecast:
    """Forecast `horizon` frames of a clip from its first `context` frames.

    Parameters
    ----------
    fit
        A fit with circle dynamics: one draw or many.
    motion
        The clip; frames after the first `context` are not looked at.
    context, horizon
        Numbers of frames, at least 2 and 1.
    seed
        Of the sampling.
    labels
        What is known of the clip; a factor that is not named is sampled.
    trained
        At most so many draws of the trained model, evenly spread over all.
    warmup, draws
        Iterations for each of them.
    components
        Pairs of draws the mixture is made of, at least one for each trained draw.

    Raises
    ------
    InputError
        As `tasks.forecast.forecast`, and if the content is not on a circle.
    """
    past = context_of(motion, context=context, horizon=horizon, labels=labels)
    model, training = multifactor_of(fit)
    seen = model.prepare(past, training)
    whole = model.prepare(lengthened(past, horizon), training).frames
    problem = clip_problem(fit, seen)
    picks, _ = stacked(fit, trained)
    count = len(next(iter(picks.values())))
    each = max(components // count, 1)

    def one(index: int) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
        values = {name: value[index] for name, value in picks.items()}
        own = ClipData(seen.frames, _condition(model, training.frames, values))
        at = replace(problem, training=own)
        return _predict_draws(at, whole, seed + index, warmup, draws, each)

    # The first alone: the others find everything compiled.
    found = [one(0)]
    with ThreadPoolExecutor(THREADS) as pool:
        found += list(pool.map(one, range(1, count)))
    encoding = training.encoding
    mean = encoding.unscaled(np.concatenate([mean for _, mean, _ in found]))
    sd = np.concatenate([sd for *_, sd in found]) * encoding.sd
    mixture = Mixture(mean, sd, np.full(len(mean), 1.0 / len(mean)))
    values = {name: np.concatenate([v[name] for v, *_ in found]) for name in found[0][0]}
    return PosteriorForecast(mixture, values, context, horizon)


def _predict_draws(
    problem: SamplingProblem, whole: Frames, seed: int, warmup: int, draws: int, count: int
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Sample the clip's unknowns; return `count` draws of them with mean and sd of each."""
    z = sample_nuts(problem, chains=1, warmup=warmup, draws=draws, seed=seed)["z"]
    kept = z[:, np.linspace(0, draws - 1, count).round().astype(int)]
    values = clip_values(problem, kept)
    sites = {name: jnp.asarray(value[0]) for name, value in values.items()}
    keys = jax.random.split(stage_key(seed, "residual scale"), count)
    at = problem.training.data[1]
    mean, variance = _predict_all(problem.model, whole, sites, at, keys)
    return values, np.asarray(mean), np.sqrt(np.asarray(variance))


@partial(jax.jit, static_argnames="model")
def _condition(model, frames, values):
    return model.condition(frames, values)


@partial(jax.jit, static_argnames="model")
def _predict_all(model, frames, values, trained, keys):
    def one(arguments):
        draw, key = arguments
        entries = model.predict(trained, frames, draw)["y"].marginals(key)
        return entries.mean, entries.variance

    return jax.lax.map(one, (values, keys))
