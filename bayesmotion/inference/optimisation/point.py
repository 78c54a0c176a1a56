"""Point estimates by a model's own search, made into fits."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ...fit import Fit
from ...gp.linalg import require_finite
from ...model import PointEstimate
from ..checkpoint import Checkpoint
from ..results import Record, make_fit

Progress = Callable[[int, float], None]


def estimate_fit(
    model: Any,
    recordings: xr.Dataset,
    search: Callable[..., PointEstimate],
    name: str,
    settings: Mapping[str, Any],
    seed: int,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
    resume: bool = False,
) -> Fit:
    """Return the fit of a model by one of its own searches.

    Parameters
    ----------
    search
        The model's verb: called with the prepared data, the settings, seed and progress.
    name
        Of the method.
    checkpoint, resume
        File for the state of the search, and whether to go on from there.

    Raises
    ------
    InputError
        If the recordings do not suit the model, or the checkpoint is of another run.
    NumericalError
        If what was maximised ends without a finite value.
    """
    began = time.perf_counter()
    data = model.prepare(recordings)
    # More steps are what a search is resumed for: their number is no part of what it is.
    run = {n: v for n, v in settings.items() if n != "max_steps"} | {"inference": name}
    part = Checkpoint.of(checkpoint, model, data, {**run, "seed": seed})
    state = part.search_state(resume)
    found = search(data, seed=seed, progress=progress, state=state, **settings)
    require_finite(found.log_density, name)
    if not found.converged:
        state.end()
    draws = {site: np.asarray(value)[None, None] for site, value in found.values.items()}
    stats = {
        "lp": np.full((1, 1), found.log_density),
        "converged": np.full((1, 1), found.converged),
        "steps": np.full((1, 1), found.steps),
    }
    told = [] if found.converged else [f"not converged after {found.steps} steps"]
    record = Record(name, settings, seed, time.perf_counter() - began, told)
    return make_fit(model, recordings, data, draws, stats, record)
