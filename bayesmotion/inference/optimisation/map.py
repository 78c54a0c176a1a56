"""Point estimates: the mode of the log density, from several starts together."""

import time
import warnings

import numpy as np
import xarray as xr

from ...errors import MotionWarning
from ...fit import Fit
from ...model import Fittable
from ..density import ProgramDensity, natural_values
from ..results import Record, make_fit
from .mode import Progress, begin, climb


def fit_map(
    model: Fittable,
    motion: xr.Dataset,
    *,
    seed: int = 0,
    starts: int = 4,
    keep: int = 2,
    max_steps: int = 1000,
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
    training = model.prepare(motion)
    density, data = ProgramDensity(model), training.data
    first = begin(model, training, seed=seed, starts=starts, max_steps=max_steps)
    optimum = climb(density, training, first, keep=keep, max_steps=max_steps, progress=progress)
    if not optimum.converged[0]:
        warnings.warn(
            f"the fit stopped after {optimum.steps[0]} steps and has not converged: "
            "give it more steps (max_steps)",
            MotionWarning,
            stacklevel=2,
        )
    values = natural_values(density, optimum.best(), data)
    draws = {name: np.asarray(value)[None, None] for name, value in values.items()}
    stats = {
        "lp": optimum.log_density[:1, None],
        "converged": optimum.converged[:1, None],
        "steps": optimum.steps[:1, None],
    }
    record = Record(
        "map",
        {"starts": starts, "keep": keep, "max_steps": max_steps},
        seed,
        time.perf_counter() - began,
        [] if optimum.converged[0] else ["not converged"],
    )
    return make_fit(model, motion, training, draws, stats, record)
