"""Leave-one-out of a Gaussian process's frames, in ArviZ's format.

For every draw of the parameters theta, a frame or an entry given all the others has an
exact density, p(y_i | y_-i, theta) (`gp.leave_out`), and

    p(y_i | y_-i) = integral p(y_i | y_-i, theta) p(theta | y_-i) dtheta

is estimated by Pareto smoothed importance sampling with the ratios
1 / p(y_i | y_-i, theta) (Bürkner, Gabry and Vehtari 2021, section 2.3). So what stands
in the log likelihood group is log p(y_i | y_-i, theta), not the conditionally
independent likelihood of a latent function, and `az.loo`, `az.compare`,
`az.plot_khat` and `az.loo_pit` work on it.

The features of a frame are independent given theta, so a frame's density is the product
of its entries' densities.
"""

import warnings
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from arviz_stats.loo import loo
from arviz_stats.utils import ELPDDataLOO
from jaxtyping import Array

from ..errors import InputError
from ..fit import Fit
from ..gp.leave_out import leave_out_each, normal_log_density
from ..inference.draws import stacked, unstacked
from ..models.multifactor import Multifactor
from ..models.poses import Frames

SAMPLE = ("chain", "draw")


def leave_one_out(
    fit: Fit,
    *,
    by: Literal["frame", "entry"] = "frame",
    features: Sequence[str] | None = None,
    most: int | None = None,
    seed: int,
) -> xr.DataTree:
    """Give the exact conditional log densities of frames or entries left out.

    Parameters
    ----------
    fit
        A fit with draws.
    by
        ``frame``: all features of a frame are left out together. ``entry``: one entry at
        a time; with draws of it, for LOO-PIT. Ask for few features: there are chains x
        draws x frames x features numbers.
    features
        Names of the features that are looked at; all where None.
    most
        Use so many draws at most, evenly spread.
    seed
        Of the predictive draws of ``entry``.

    Returns
    -------
    ``log_likelihood`` with ``y`` (chain, draw, point), of scaled features; ``posterior``
    with the hyperparameters; by entry also ``posterior_predictive`` and
    ``observed_data``. Entries that were not seen are no points. The coordinates
    ``frame``, ``clip`` and ``feature`` of a point say what it is.

    Raises
    ------
    InputError
        If a feature is not one of the fit's.
    """
    columns = _columns(fit, features)
    values, shape = stacked(fit, most)
    frames = fit.training.frames
    seen = seen_entries_of(frames)[:, columns]
    if by == "frame":
        return _by_frame(fit, values, shape, columns, seen)
    return _by_entry(fit, values, shape, columns, seen, seed)


def elpd_of_frames(fit: Fit, most: int | None = None) -> ELPDDataLOO:
    """Estimate the expected log predictive density of frames left out.

    With draws this is `az.loo` of `leave_one_out`. A point estimate has one draw and no
    importance weights: its parameters are taken for known, so it knows a little of
    every frame it is asked about, and its figures are somewhat too high.
    """
    tree = leave_one_out(fit, most=most, seed=0)
    density = tree["log_likelihood"].to_dataset()["y"]
    if density.sizes["chain"] * density.sizes["draw"] > 1:
        return pareto_smoothed(tree)
    return elpd(density.isel(chain=0, draw=0, drop=True), n_samples=1)


def pareto_smoothed(tree: xr.DataTree) -> ELPDDataLOO:
    """Run `az.loo` without its warning of high Pareto k: the result says it itself."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Estimated shape parameter of Pareto", UserWarning)
        # A single block is its own sum.
        warnings.filterwarnings("ignore", "The point-wise LOO is the same", UserWarning)
        result = loo(tree, pointwise=True)
    assert isinstance(result, ELPDDataLOO)
    return result


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


def seen_entries_of(frames: Frames) -> np.ndarray:
    """Give which entries (N, D) are seen."""
    return np.einsum("pn,pd->nd", frames.missing.rows, frames.missing.columns) > 0


def point_coords(fit: Fit, rows: np.ndarray) -> dict[str, tuple[str, np.ndarray]]:
    """Name the frame (within all clips) and the clip of each point."""
    training = fit.training
    clip = np.asarray(training.clips)[np.asarray(training.frames.clip)]
    return {"frame": ("point", rows), "clip": ("point", clip[rows])}


def _by_frame(fit, values, shape, columns, seen) -> xr.DataTree:
    density = unstacked(_frame_densities(fit.model, fit.training.frames, values, columns), shape)
    rows = np.flatnonzero(seen.any(axis=1))
    y = ((*SAMPLE, "point"), density[:, :, rows])
    likelihood = xr.Dataset({"y": y}, point_coords(fit, rows))
    groups = {"posterior": _posterior(fit, values, shape), "log_likelihood": likelihood}
    return xr.DataTree.from_dict(groups)


def _by_entry(fit, values, shape, columns, seen, seed) -> xr.DataTree:
    frames = fit.training.frames
    mean, variance = _entries(fit.model, frames, values, columns)
    y = np.asarray(frames.y)[:, columns]
    rows, picked = np.nonzero(seen)
    mean, sd = (unstacked(a, shape)[:, :, rows, picked] for a in (mean, jnp.sqrt(variance)))
    observed = y[rows, picked]
    density = np.asarray(normal_log_density(observed, mean, sd**2))
    draws = mean + sd * np.random.default_rng(seed).normal(size=mean.shape)
    labels = np.asarray(fit.training.encoding.layout.labels)[columns]
    coords = point_coords(fit, rows) | {"feature": ("point", labels[picked])}
    dims = (*SAMPLE, "point")
    return xr.DataTree.from_dict(
        {
            "posterior": _posterior(fit, values, shape),
            "log_likelihood": xr.Dataset({"y": (dims, density)}, coords),
            "posterior_predictive": xr.Dataset({"y": (dims, draws)}, coords),
            "observed_data": xr.Dataset({"y": ("point", observed)}, coords),
        }
    )


@partial(jax.jit, static_argnames="model")
def _frame_densities(
    model: Multifactor, frames: Frames, values: Mapping[str, Array], columns: Array
) -> Array:
    """Log density (S, N) of the seen entries of every frame given all other frames."""
    y = jnp.asarray(frames.y)
    seen = jnp.einsum("pn,pd->nd", frames.missing.rows, frames.missing.columns)

    def one(draw: Mapping[str, Array]) -> Array:
        K = model.covariance(frames, draw)
        mean, variance = leave_out_each(y, K, draw["scale"], frames.missing)
        each = jnp.where(seen > 0, normal_log_density(y, mean, variance), 0.0)
        return jnp.sum(each[:, columns], axis=1)

    return jax.lax.map(one, dict(values))


@partial(jax.jit, static_argnames="model")
def _entries(
    model: Multifactor, frames: Frames, values: Mapping[str, Array], columns: Array
) -> tuple[Array, Array]:
    """Mean and variance (S, N, columns) of every entry given all others."""
    y = jnp.asarray(frames.y)

    def one(draw: Mapping[str, Array]) -> tuple[Array, Array]:
        K = model.covariance(frames, draw)
        mean, variance = leave_out_each(y, K, draw["scale"], frames.missing)
        return mean[:, columns], variance[:, columns]

    return jax.lax.map(one, dict(values))


def _columns(fit: Fit, features: Sequence[str] | None) -> np.ndarray:
    labels = list(fit.training.encoding.layout.labels)
    if features is None:
        return np.arange(len(labels))
    for name in features:
        if name not in labels:
            raise InputError(
                f"feature {name!r}", "the fit has none of this name", f"One is {labels[0]!r}"
            )
    return np.array([labels.index(name) for name in features])


def _posterior(fit: Fit, values: Mapping[str, Array], shape: tuple[int, int]) -> xr.Dataset:
    """Give the hyperparameters, from which ArviZ takes how efficient the draws are."""
    names = [n for n in fit.model.hyper_names if values[n].ndim == 1]
    return xr.Dataset({n: (SAMPLE, unstacked(values[n], shape)) for n in names})
