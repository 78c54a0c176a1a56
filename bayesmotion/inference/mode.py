"""The search for a mode, the same for point estimates and for samplers' beginnings.

A model may name a plainer one: the mode of that is found first, and the model's own
starts are made of it.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np

from ..gp.linalg import AnyArray, require_finite
from ..models.registry import Model, Nested, TrainingData
from .density import ProgramDensity
from .optimise import Optimum, maximise

Progress = Callable[[int, float], None]


def stack(starts: Sequence[Mapping[str, AnyArray]]) -> dict[str, jnp.ndarray]:
    """Stack the values of several starts along a leading axis."""
    return {name: jnp.stack([jnp.asarray(s[name]) for s in starts]) for name in starts[0]}


def begin(
    model: Model, training: TrainingData, *, seed: int, starts: int, max_steps: int
) -> list[dict[str, np.ndarray]]:
    """Give a model's starting values, those of its plainer model's mode among them.

    Raises
    ------
    NumericalError
        If no start of the plainer model has a finite log density.
    """
    plainer = model.plainer if isinstance(model, Nested) else None
    if plainer is None:
        return model.starts(training, seed, starts)
    assert isinstance(model, Nested)
    density, data = ProgramDensity(plainer), training.data
    first = begin(plainer, training, seed=seed, starts=starts, max_steps=max_steps)
    optimum = climb(density, training, first, keep=1, max_steps=max_steps)
    found: dict[str, AnyArray] = {**density.natural(optimum.best(), data)}
    return model.starts_from(training, seed, starts, found)


def climb(
    density: ProgramDensity,
    training: TrainingData,
    starts: list[dict[str, np.ndarray]],
    *,
    keep: int,
    max_steps: int,
    progress: Progress | None = None,
) -> Optimum:
    """Find the mode of a density of a model's program from starting values of its sites.

    Raises
    ------
    NumericalError
        If no start has a finite log density.
    """
    model: Any = density.model
    data = training.data
    first = stack([density.real(start, data) for start in starts])
    roots = model.roots(training, starts[0]) if isinstance(model, Nested) else {}
    optimum = maximise(
        density, first, data, max_steps=max_steps, keep=keep, roots=roots, progress=progress
    )
    require_finite(optimum.log_density[0], "y")
    return optimum
