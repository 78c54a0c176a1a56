"""The search for a mode, the same for point estimates and for samplers' beginnings.

A model may name a simpler one (`init_from`): the mode of that is found first, and its own
starts are made of it.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...gp.linalg import AnyArray, require_finite
from ...model import Fittable, ProgramData, WarmStarted
from ..density import ProgramDensity, natural_values, real_values
from .optimise import Optimum, maximise, stack

Progress = Callable[[int, float], None]


def begin(
    model: Fittable, training: ProgramData, *, seed: int, starts: int, max_steps: int
) -> list[dict[str, np.ndarray]]:
    """Give a model's starting values, those from the mode of `init_from` among them.

    Raises
    ------
    NumericalError
        If no start of the simpler model has a finite log density.
    """
    simpler = model.init_from if isinstance(model, WarmStarted) else None
    if simpler is None:
        return model.initial_values(training, seed, starts)
    assert isinstance(model, WarmStarted)
    density, data = ProgramDensity(simpler), training.data
    first = begin(simpler, training, seed=seed, starts=starts, max_steps=max_steps)
    optimum = climb(density, training, first, keep=1, max_steps=max_steps)
    found: dict[str, AnyArray] = {**natural_values(density, optimum.best(), data)}
    return model.initial_values_from(training, seed, starts, found)


def climb(
    density: ProgramDensity,
    training: ProgramData,
    starts: list[dict[str, np.ndarray]],
    *,
    keep: int,
    max_steps: int,
    progress: Progress | None = None,
    keep_state: Callable[[Any, int], None] | None = None,
    resumed: Mapping[str, AnyArray] | None = None,
) -> Optimum:
    """Find the mode of a density of a model's program from starting values of its sites.

    Parameters
    ----------
    density
        Of the program.
    training
        Its data.
    starts
        Values of the sites; with `resumed` the first says where preconditioners are from.
    keep, max_steps, progress, keep_state
        As in `maximise`.
    resumed
        What `keep_state` was last told of a search that is to go on.

    Raises
    ------
    NumericalError
        If no start has a finite log density.
    """
    model: Any = density.model
    data = training.data
    first = resumed or stack([real_values(density, start, data) for start in starts])
    roots = model.preconditioners(training, starts[0]) if isinstance(model, WarmStarted) else {}
    optimum = maximise(
        density, first, data, max_steps=max_steps, keep=keep, roots=roots, progress=progress,
        keep_state=keep_state,
    )  # fmt: skip
    require_finite(optimum.log_density[0], "y")
    return optimum
