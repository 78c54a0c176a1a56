"""Point estimates: the mode of the log density, from several starts together."""

import json
import time
import warnings
from collections.abc import Callable, Mapping, Sequence

import jax.numpy as jnp
import numpy as np
import xarray as xr

from ..errors import MotionWarning
from ..fit import SCHEMA, Fit, Training, data_hash, prepare, versions
from ..gp.linalg import AnyArray, require_finite
from ..models.multifactor import Multifactor
from ..models.starts import training_starts
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
    density = ProgramDensity(model)
    data = (training.frames,)
    begin = training_starts(model, training.frames, seed, starts)
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
    values = {name: np.asarray(v) for name, v in density.natural(optimum.best(), data).items()}
    attrs = {
        "seed": seed,
        "centre": int(centre),
        "turned": int(turned),
        "seconds": time.perf_counter() - began,
    }
    return Fit(model, motion, _tree(model, training, values, optimum, attrs))


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
