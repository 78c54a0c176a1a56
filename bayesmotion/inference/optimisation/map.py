"""Point estimates: the mode of the log density, from several starts together."""

import time
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from ...errors import MotionWarning
from ...fit import Fit
from ...model import Fittable
from ..checkpoint import Checkpoint
from ..density import ProgramDensity, natural_values
from ..results import Record, make_fit
from .mode import Progress, begin, climb

# What the steps done are called beside the values of sites.
STEPS = "steps done"


def fit_map(
    model: Fittable,
    motion: xr.Dataset,
    *,
    seed: int = 0,
    starts: int = 4,
    keep: int = 2,
    max_steps: int = 1000,
    checkpoint: str | Path | None = None,
    resume: bool = False,
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
    checkpoint
        File for the state after every block of 20 steps; none where None. It is left there:
        who has a fit that has converged may delete it.
    resume
        Go on from the checkpoint if there is one, for `max_steps` more; else begin anew.
    progress
        Called with the steps done and the best log density.

    Raises
    ------
    InputError
        If the clips do not fit together or lack a label, or the checkpoint is of another run.
    NumericalError
        If no start has a finite log density.
    """
    began = time.perf_counter()
    training = model.prepare(motion)
    density, data = ProgramDensity(model), training.data
    # More steps are what a run is resumed for: their number is no part of what it is.
    run = {"inference": "map", "seed": seed, "starts": starts, "keep": keep}
    part = Checkpoint.of(checkpoint, model, training, run)
    saved = part.load() if resume else None
    before = 0 if saved is None else int(saved.pop(STEPS))
    if saved is None:
        first = begin(model, training, seed=seed, starts=starts, max_steps=max_steps)
    else:
        best = {name: value[0] for name, value in saved.items()}
        first = [{n: np.asarray(v) for n, v in natural_values(density, best, data).items()}]

    def keep_state(values: Mapping[str, np.ndarray], steps: int) -> None:
        part.save({**values, STEPS: np.array(before + steps)})

    optimum = climb(
        density, training, first, keep=keep, max_steps=max_steps, progress=progress,
        keep_state=None if checkpoint is None else keep_state, resumed=saved,
    )  # fmt: skip
    steps = before + optimum.steps
    if not optimum.converged[0]:
        warnings.warn(
            f"the fit stopped after {steps[0]} steps and has not converged: "
            "give it more steps (max_steps)",
            MotionWarning,
            stacklevel=2,
        )
    values = natural_values(density, optimum.best(), data)
    draws = {name: np.asarray(value)[None, None] for name, value in values.items()}
    stats = {
        "lp": optimum.log_density[:1, None],
        "converged": optimum.converged[:1, None],
        "steps": steps[:1, None],
    }
    record = Record(
        "map",
        {"starts": starts, "keep": keep, "max_steps": max_steps},
        seed,
        time.perf_counter() - began,
        [] if optimum.converged[0] else ["not converged"],
    )
    return make_fit(model, motion, training, draws, stats, record)
