"""Point estimates: the mode of the log density, from several starts together."""

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
import xarray as xr

from ..errors import MotionWarning
from ..fit import Fit
from ..gp.linalg import AnyArray, require_finite
from ..models.registry import Model
from .density import ProgramDensity
from .optimise import maximise
from .results import Record, make_fit

Progress = Callable[[int, float], None]


def stack(starts: Sequence[Mapping[str, AnyArray]]) -> dict[str, jnp.ndarray]:
    """Stack the values of several starts along a leading axis."""
    return {name: jnp.stack([jnp.asarray(s[name]) for s in starts]) for name in starts[0]}


def fit_map(
    model: Model,
    motion: xr.Dataset,
    *,
    seed: int = 0,
    starts: int = 4,
    keep: int = 2,
    max_steps: int = 1000,
    preparation: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fit a model by its posterior mode.

    Parameters
    ----------
    model
        The model with its settings.
    motion
        Training clips with a text label for each factor of the model.
    seed
        Of the starts' random part.
    starts, keep
        How many starts are tried, and how many of them are followed to the end.
    max_steps
        At most so many L-BFGS steps.
    preparation
        Keywords of the model's `prepare`, which makes clips into features.
    progress
        Called with the steps done and the best log density.

    Raises
    ------
    InputError
        If the clips do not fit together or lack a label.
    NumericalError
        If no start has a finite log density.
    """
    began = time.perf_counter()
    preparation = dict(preparation or {})
    training = model.prepare(motion, **preparation)
    density, data = ProgramDensity(model), training.data
    begin = model.starts(training, seed, starts)
    first = stack([density.real(start, data) for start in begin])
    optimum = maximise(density, first, data, max_steps=max_steps, keep=keep, progress=progress)
    require_finite(optimum.log_density[0], "y")
    if not optimum.converged[0]:
        warnings.warn(
            f"the fit stopped after {optimum.steps[0]} steps and has not converged: "
            "give it more steps (max_steps)",
            MotionWarning,
            stacklevel=2,
        )
    values = density.natural(optimum.best(), data)
    draws = {name: np.asarray(value)[None, None] for name, value in values.items()}
    stats = {
        "lp": optimum.log_density[:1, None],
        "converged": optimum.converged[:1, None],
        "steps": optimum.steps[:1, None],
    }
    record = Record(
        "map",
        {"starts": starts, "keep": keep, "max_steps": max_steps},
        preparation,
        seed,
        time.perf_counter() - began,
        [] if optimum.converged[0] else ["not converged"],
    )
    return make_fit(model, motion, training, draws, stats, record)
