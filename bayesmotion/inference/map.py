"""Point estimates: the mode of the log density, from several starts together."""

import json
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import xarray as xr

from ..errors import MotionWarning
from ..fit import SCHEMA, Fit, Training, data_hash, prepare, versions
from ..gp.linalg import AnyArray, require_finite
from ..models.multifactor import Multifactor
from ..models.poses import Frames
from ..models.starts import search_roots, training_starts
from .density import ProgramDensity
from .optimise import Optimum, maximise

Progress = Callable[[int, float], None]


def stack(starts: Sequence[Mapping[str, AnyArray]]) -> dict[str, jnp.ndarray]:
    """Stack the values of several starts along a leading axis."""
    return {name: jnp.stack([jnp.asarray(s[name]) for s in starts]) for name in starts[0]}


def fit_map(
    model: Multifactor,
    motion: xr.Dataset,
    *,
    seed: int = 0,
    starts: int = 4,
    keep: int = 2,
    max_steps: int = 1000,
    centre: bool = False,
    turned: bool = False,
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
    centre, turned
        Whether features are centred, and whether each clip's heading is taken out.
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
    training = prepare(motion, tuple(f.name for f in model.factors), centre=centre, turned=turned)
    on_circle = None
    if model.dynamics != "circle":
        # The circle is the plainest path: its mode is where others begin.
        plain = replace(model, dynamics="circle")
        found = _search(plain, training.frames, seed, starts, 1, max_steps, None, None)
        on_circle = _natural(plain, training.frames, found)
    optimum = _search(model, training.frames, seed, starts, keep, max_steps, on_circle, progress)
    require_finite(optimum.log_density[0], "y")
    if not optimum.converged[0]:
        warnings.warn(
            f"the fit stopped after {optimum.steps[0]} steps and has not converged: "
            "give it more steps (max_steps)",
            MotionWarning,
            stacklevel=2,
        )
    values = _natural(model, training.frames, optimum)
    attrs = {
        "seed": seed,
        "centre": int(centre),
        "turned": int(turned),
        "seconds": time.perf_counter() - began,
    }
    return Fit(model, motion, _tree(model, training, values, optimum, attrs))


def _search(
    model: Multifactor,
    frames: Frames,
    seed: int,
    starts: int,
    keep: int,
    max_steps: int,
    on_circle: Mapping[str, np.ndarray] | None,
    progress: Progress | None,
) -> Optimum:
    """Look for a model's mode from its training starts."""
    density, data = ProgramDensity(model), (frames,)
    begin = training_starts(model, frames, seed, starts, on_circle)
    first = stack([density.real(start, data) for start in begin])
    roots = search_roots(model, frames, begin[0])
    return maximise(
        density, first, data, max_steps=max_steps, keep=keep, roots=roots, progress=progress
    )


def _natural(model: Multifactor, frames: Frames, optimum: Optimum) -> dict[str, np.ndarray]:
    """Give the best start's sites in their own units."""
    values = ProgramDensity(model).natural(optimum.best(), (frames,))
    return {name: np.asarray(value) for name, value in values.items()}


def _tree(
    model: Multifactor,
    training: Training,
    values: Mapping[str, np.ndarray],
    optimum: Optimum,
    attrs: Mapping[str, object],
) -> xr.DataTree:
    """Put a point estimate into ArviZ's groups, as a posterior of one draw."""
    coords, dims = model.coords(training), model.dims()
    posterior = {
        name: (("chain", "draw", *dims[name]), value[None, None]) for name, value in values.items()
    }
    one = {"chain": [0], "draw": [0]}
    used = {dim for name in values for dim in dims[name]}
    frames = training.frames
    seen = np.einsum("pn,pd->nd", frames.missing.rows, frames.missing.columns) > 0
    y = (("frame", "feature"), np.where(seen, frames.y, np.nan))
    feature = {"feature": list(training.encoding.layout.labels)}
    stats = {
        "lp": (("chain", "draw"), optimum.log_density[:1, None]),
        "converged": (("chain", "draw"), optimum.converged[:1, None]),
        "steps": (("chain", "draw"), optimum.steps[:1, None]),
    }
    constant = {
        "mean": ("feature", training.encoding.mean),
        "spread": ("feature", training.encoding.spread),
        "clip": ("frame", np.asarray(frames.clip)),
    }
    tree = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset(posterior, {**one, **{d: coords[d] for d in sorted(used)}}),
            "sample_stats": xr.Dataset(stats, one),
            "observed_data": xr.Dataset({"y": y}, feature),
            "constant_data": xr.Dataset(constant, feature),
        }
    )
    tree.attrs = {
        "schema": SCHEMA,
        "inference": "map",
        "versions": versions(),
        "data_hash": data_hash(training),
        "warnings": json.dumps([] if optimum.converged[0] else ["not converged"]),
        **attrs,
    }
    return tree
