"""Fits by local learning, of models that can be learned patch by patch."""

import time
from typing import Any

import numpy as np
import xarray as xr

from ..errors import InputError
from ..fit import Fit
from ..model import FittedLocally, Progress
from .results import Record, make_fit

SWEEPS = 40


def fit_local(
    model: Any,
    motion: xr.Dataset,
    *,
    seed: int = 0,
    sweeps: int = SWEEPS,
    progress: Progress | None = None,
    **settings: float,
) -> Fit:
    """Fit a model patch by patch (`model.FittedLocally`).

    Parameters
    ----------
    model
        A model with local learning of its own.
    motion
        Training recordings.
    seed
        Of the patches.
    sweeps
        How often the latent surface is covered.
    progress
        Called with the sweeps done.
    settings
        Further keywords of the model's `local_learning`.

    Raises
    ------
    InputError
        If the model cannot be learned so, with these settings or at all.
    """
    if not isinstance(model, FittedLocally):
        raise InputError(
            f"model {getattr(model, 'name', model)!r}", "it has no local learning", "Use fit_map"
        )
    began = time.perf_counter()
    training: Any = model.prepare(motion)
    found = model.local_learning(training, seed=seed, sweeps=sweeps, progress=progress, **settings)
    draws = {name: np.asarray(value)[None, None] for name, value in found.values.items()}
    stats = {"lp": np.array([[found.log_density]]), "sweeps": np.array([[sweeps]])}
    seconds = time.perf_counter() - began
    record = Record("local", {"sweeps": sweeps, **settings}, {}, seed, seconds)
    return make_fit(model, motion, training, draws, stats, record)
