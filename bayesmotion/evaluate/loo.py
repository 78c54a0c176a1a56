"""Leave-one-out in ArviZ's format, for every model.

For every draw of the parameters theta a point (a frame with all its features, a segment, a
clip) given all the others has a density, p(y_i | y_-i, theta) (`Model.pointwise`), exact for
Gaussian processes (`gp.leave_out`), and

    p(y_i | y_-i) = integral p(y_i | y_-i, theta) p(theta | y_-i) dtheta

is estimated by Pareto smoothed importance sampling with the ratios
1 / p(y_i | y_-i, theta) (Bürkner, Gabry and Vehtari 2021, section 2.3). So what stands
in the log likelihood group is log p(y_i | y_-i, theta), not the conditionally
independent likelihood of a latent function, and `az.loo`, `az.compare`,
`az.plot_khat` and `az.loo_pit` work on it.
"""

import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from arviz_stats.loo import loo
from arviz_stats.utils import ELPDDataLOO
from jaxtyping import Array

from ..errors import InputError
from ..fit import Fit
from ..gp.leave_out import normal_log_density
from ..gp.linalg import AnyArray
from ..inference.draws import stacked, unstacked
from ..inference.pointwise import SAMPLE, pointwise_log_likelihood
from ..inference.predicting import require_model
from ..model import LeavesEntriesOut
from ..programs import one_at_a_time


@one_at_a_time
def leave_one_out(
    fit: Fit,
    *,
    by: Literal["point", "entry"] = "point",
    features: Sequence[str] | None = None,
    most: int | None = None,
    seed: int = 0,
) -> xr.DataTree:
    """Return the conditional log densities of points or entries left out.

    Parameters
    ----------
    fit
        A fit of any model.
    by
        ``point``: what the model takes for one, such as all features of a frame. ``entry``:
        one entry at a time, for models that tell it (`model.LeavesEntriesOut`); with draws of
        it, for LOO-PIT. Ask for few features: there are chains x draws x rows x features
        numbers.
    features
        By entry: names of the features that are looked at; all where None.
    most
        Use so many draws at most, evenly spread.
    seed
        Of the predictive draws of ``entry``.

    Returns
    -------
    ``log_likelihood`` with ``y`` (chain, draw, point), of the model's own units;
    ``posterior`` with the scalar sites; by entry also ``posterior_predictive`` and
    ``observed_data``. Entries that were not seen are no points. The coordinates of a point
    say what it is: ``frame``, ``clip``, ``feature``, ...

    Raises
    ------
    InputError
        If a feature is not one of the fit's, features are named but no entries asked for, or
        the model does not tell entries apart.
    """
    model = require_model(fit)
    if by == "point" and features is not None:
        raise InputError("features", "a point is all of them together", "Use by='entry'")
    values, shape = stacked(fit, most)
    if by == "entry":
        return _by_entry(fit, values, shape, features, seed)
    likelihood = pointwise_log_likelihood(model, fit.training, values, shape)
    return xr.DataTree.from_dict(
        {"posterior": _scalars(values, shape), "log_likelihood": likelihood}
    )


@one_at_a_time
def elpd_of_points(fit: Fit, most: int | None = None) -> ELPDDataLOO:
    """Estimate the expected log predictive density of points left out.

    With draws this is `az.loo` of `leave_one_out`. A point estimate has one draw and no
    importance weights: its parameters are taken for known, so it knows a little of
    every point it is asked about, and its figures are somewhat too high.
    """
    tree = leave_one_out(fit, most=most)
    density = tree["log_likelihood"].to_dataset()["y"]
    if not fit.point_estimate:
        return pareto_smoothed(tree)
    return elpd(density.isel(chain=0, draw=0, drop=True), n_samples=1)


def pareto_smoothed(tree: xr.DataTree) -> ELPDDataLOO:
    """Run `az.loo` without its warning of high Pareto k: the result says it itself.

    Raises
    ------
    InputError
        If the draws that matter for a point left out are one and the same.
    """
    try:
        result = _loo(tree)
    except ValueError as error:
        if "tail values are the same" not in str(error):
            raise
        raise InputError(
            "leave-one-out", "the draws that matter for a point are one and the same",
            "Sample longer: `diagnose` says where chains stand still",
        ) from error  # fmt: skip
    assert isinstance(result, ELPDDataLOO)
    return result


def _loo(tree: xr.DataTree) -> object:
    with warnings.catch_warnings():
        # The result says it itself, by `warning` and `pareto_k`.
        warnings.filterwarnings("ignore", "Estimated shape parameter of Pareto", UserWarning)
        # A single block is its own sum.
        warnings.filterwarnings("ignore", "The point-wise LOO is the same", UserWarning)
        return loo(tree, pointwise=True)


def elpd(points: xr.DataArray, *, n_samples: int, k_hat: xr.DataArray | None = None) -> ELPDDataLOO:
    """Put log densities of points left out into ArviZ's format.

    Parameters
    ----------
    points
        (point,) log predictive density of each.
    n_samples
        Number of draws behind them.
    k_hat
        (point,) Pareto k of each, where importance sampling was used.
    """
    values = points.values
    good_k = min(1.0 - 1.0 / np.log10(n_samples), 0.7) if n_samples > 1 else 0.7
    return ELPDDataLOO(
        elpd=float(values.sum()),
        se=float(np.sqrt(values.size * np.var(values))),
        # How many parameters it cost is not told by refits.
        p=float("nan"),
        n_samples=n_samples,
        n_data_points=int(values.size),
        scale="log",
        warning=bool(k_hat is not None and np.any(k_hat.values > good_k)),
        good_k=good_k,
        elpd_i=points,
        pareto_k=k_hat,  # pyright: ignore[reportArgumentType]  ArviZ's own default is None
    )


@partial(jax.jit, static_argnames="model")
def _entries(
    model: Any, frames: Any, values: Mapping[str, Array], columns: AnyArray
) -> tuple[Array, Array]:
    """Mean and variance (S, N, columns) of every entry given all others."""

    def one(draw: Mapping[str, Array]) -> tuple[Array, Array]:
        mean, variance = model.entries(frames, draw)
        return mean[:, columns], variance[:, columns]

    return jax.lax.map(one, dict(values))


def _by_entry(
    fit: Fit,
    values: Mapping[str, Array],
    shape: tuple[int, int],
    features: Sequence[str] | None,
    seed: int,
) -> xr.DataTree:
    model = require_model(fit)
    if not isinstance(model, LeavesEntriesOut):
        raise InputError(
            f"model {model.name!r}", "it does not leave single entries out", "Use by='point'"
        )
    observed = next(iter(fit.training.observed().data_vars.values()))
    label = str(observed.dims[1])
    columns = _columns(observed[label].values.tolist(), features)
    y = observed.values[:, columns]
    rows, picked = np.nonzero(np.isfinite(y))
    mean, variance = _entries(model, fit.training.data[0], values, columns)
    mean, sd = (unstacked(a, shape)[:, :, rows, picked] for a in (mean, jnp.sqrt(variance)))
    known = y[rows, picked]
    density = np.asarray(normal_log_density(known, mean, sd**2))
    draws = mean + sd * np.random.default_rng(seed).normal(size=mean.shape)
    points = {n: ("point", v[rows]) for n, (_, v) in model.points(fit.training).items()}
    coords = points | {label: ("point", observed[label].values[columns][picked])}
    dims = (*SAMPLE, "point")
    return xr.DataTree.from_dict(
        {
            "posterior": _scalars(values, shape),
            "log_likelihood": xr.Dataset({"y": (dims, density)}, coords),
            "posterior_predictive": xr.Dataset({"y": (dims, draws)}, coords),
            "observed_data": xr.Dataset({"y": ("point", known)}, coords),
        }
    )


def _columns(labels: list[str], features: Sequence[str] | None) -> np.ndarray:
    if features is None:
        return np.arange(len(labels))
    for name in features:
        if name not in labels:
            raise InputError(
                f"feature {name!r}", "the fit has none of this name", f"One is {labels[0]!r}"
            )
    return np.array([labels.index(name) for name in features])


def _scalars(values: Mapping[str, Array], shape: tuple[int, int]) -> xr.Dataset:
    """Return the scalar sites, or else all, from which ArviZ takes how efficient draws are."""
    shown = {name: value for name, value in values.items() if value.ndim == 1} or values
    return xr.Dataset(
        {
            name: ((*SAMPLE, *(f"{name}_{axis}" for axis in range(1, value.ndim))),
                   unstacked(value, shape))
            for name, value in shown.items()
        }
    )  # fmt: skip
