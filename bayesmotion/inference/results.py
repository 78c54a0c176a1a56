"""The one place where draws, however they were made, become a fit's tree.

The tree has ArviZ's groups:

    posterior        every site and what it determines            (chain, draw, ...)
    sample_stats     figures of the optimiser or sampler          (chain, draw)
    log_likelihood   log p(y_i | y_-i, theta) of every point i    (chain, draw, point)
    joint_log_likelihood   log p(y | theta) of every observed site   (chain, draw)
    log_prior        log density of every other site              (chain, draw)
    observed_data, constant_data

A point is what is left out together, such as a frame with all its features, so that
`az.loo` is right on the tree. Points add up to the joint log likelihood only where they are
independent given theta, which under a Gaussian process they are not: what changes the weight
of the likelihood (`evaluate.checks.prior_sensitivity`) takes the joint one. For one draw all
joint log likelihoods and log priors add up to the log density of the model's program.
Models that have no points yet (`model.Fittable` only) have the parts of `log_densities` in
``log_likelihood``. Attributes: ``schema``, ``inference``, ``model`` and ``settings`` and
``versions`` and ``warnings`` as JSON, ``seed``, ``data_hash`` of
what is explained (equal for different models of the same data), ``seconds``.
"""

import importlib.metadata
import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array
from numpyro import distributions as dist
from numpyro.handlers import substitute, trace

from ..errors import InputError, MotionWarning
from ..fit import SCHEMA, Fit
from ..gp.linalg import AnyArray
from ..model import Cautious, Data, Fittable, Model, ProgramData
from ..netcdf import values_hash
from ..registry import describe_model
from .draws import one_by_one
from .pointwise import SAMPLE, pointwise_log_likelihood

PACKAGES = ("bayesmotion", "numpyro", "jax", "arviz", "emcee", "xarray", "numpy")
# Draws whose covariance matrices are in memory together.
BLOCK = 8


@dataclass(frozen=True)
class Record:
    """How a fit was made.

    inference
        ``map``, ``nuts`` or ``ensemble``.
    settings
        Settings of the inference as plain values.
    seed
        The one seed.
    seconds
        How long it took.
    warnings
        What to know before trusting the fit, in sentences.
    more
        Further attributes of the tree.
    """

    inference: str
    settings: Mapping[str, Any]
    seed: int
    seconds: float
    warnings: Sequence[str] = ()
    more: Mapping[str, Any] = field(default_factory=dict)


def make_fit(
    model: Fittable,
    motion: xr.Dataset,
    training: ProgramData,
    draws: Mapping[str, AnyArray],
    stats: Mapping[str, AnyArray],
    record: Record,
) -> Fit:
    """Make a fit of draws.

    Parameters
    ----------
    draws
        For every site and deterministic value of the program (chain, draw, ...).
    stats
        Figures of the optimiser or sampler (chain, draw).

    Warns
    -----
    MotionWarning
        Of what a model says not to trust (`model.Cautious`); it is kept with the fit.
    """
    cautions = []
    if isinstance(model, Cautious):
        medians = {n: np.asarray(np.median(value, (0, 1))) for n, value in draws.items()}
        cautions = model.cautions(training, medians)
    for sentence in cautions:
        warnings.warn(sentence, MotionWarning, stacklevel=3)
    likelihood, prior = log_densities(model, draws, training.data)
    dims, coords = model.dims(), model.coords(training)
    joint = {
        name: value.sum(axis=tuple(range(2, value.ndim))) for name, value in likelihood.items()
    }
    if isinstance(model, Model) and isinstance(training, Data):
        shape = next(iter(draws.values())).shape[:2]
        try:
            points = pointwise_log_likelihood(model, training, _flat(draws), (shape[0], shape[1]))
        except InputError:
            # A bound has no densities of points left out; `leave_one_out` says so when asked.
            points = xr.Dataset()
    else:
        parts = {
            name: _part_dims(dims[name], value.shape[2:], coords)
            for name, value in likelihood.items()
        }
        points = _group(likelihood, parts, coords)
    groups = {
        "posterior": _group(draws, {name: dims[name] for name in draws}, coords),
        "sample_stats": _group(stats, dict.fromkeys(stats, ()), {}),
        "log_likelihood": points,
        "joint_log_likelihood": _group(joint, dict.fromkeys(joint, ()), {}),
        "log_prior": _group(prior, dict.fromkeys(prior, ()), {}),
        "observed_data": training.observed(),
        "constant_data": training.constants(),
    }
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = {
        "schema": SCHEMA,
        "inference": record.inference,
        "model": json.dumps(describe_model(model)),
        "settings": json.dumps(dict(record.settings)),
        "seed": record.seed,
        "seconds": record.seconds,
        "versions": versions(),
        "data_hash": data_hash(training),
        "warnings": json.dumps([*record.warnings, *cautions]),
        **record.more,
    }
    return Fit(model, motion, tree)


def log_densities(
    model: Fittable, draws: Mapping[str, AnyArray], data: tuple
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Give log likelihoods (chain, draw, parts) and log priors (chain, draw) of draws.

    An observed site's log likelihood has the parts its distribution says are
    independent (`log_prob_parts`), else as many as its `log_prob`.
    """
    shape = next(iter(draws.values())).shape[:2]
    parts = one_by_one(partial(_log_densities, model), _flat(draws), data)
    likelihood, prior = (
        {name: np.asarray(v).reshape(*shape, *v.shape[1:]) for name, v in part.items()}
        for part in parts
    )
    return likelihood, prior


def _flat(draws: Mapping[str, AnyArray]) -> dict[str, np.ndarray]:
    """Return draws (chain, draw, ...) with one leading axis."""
    chains, each = next(iter(draws.values())).shape[:2]
    # Counted, for a site may have no entries at all (the shape of a single level).
    count = chains * each
    return {name: np.asarray(v).reshape(count, *v.shape[2:]) for name, v in draws.items()}


@partial(jax.jit, static_argnames="model")
def _log_densities(
    model: Any, values: dict[str, Array], data: tuple
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return log likelihoods and log priors of one draw, by site."""
    sites = trace(substitute(model.program, data=values)).get_trace(*data)
    likelihood, prior = {}, {}
    for name, site in sites.items():
        if site["type"] != "sample":
            continue
        fn, value = site["fn"], site["value"]
        if site["is_observed"] and not isinstance(fn, dist.Unit):
            parts = getattr(fn, "log_prob_parts", fn.log_prob)
            likelihood[name] = jnp.asarray(parts(value))
        else:
            # A factor is an observed site of its own kind: a part of the prior written out.
            prior[name] = jnp.sum(fn.log_prob(value))
    return likelihood, prior


def _group(
    values: Mapping[str, AnyArray],
    dims: Mapping[str, tuple[str, ...]],
    coords: Mapping[str, list],
) -> xr.Dataset:
    """Put values (chain, draw, ...) into a data set with labelled dimensions."""
    arrays = {name: ((*SAMPLE, *dims[name]), np.asarray(value)) for name, value in values.items()}
    chains, draws = next(iter(arrays.values()))[1].shape[:2] if arrays else (0, 0)
    labels: dict[str, Any] = {"chain": np.arange(chains), "draw": np.arange(draws)}
    used = {dim for name in values for dim in dims[name]}
    return xr.Dataset(arrays, labels | {dim: coords[dim] for dim in sorted(used)})


def _part_dims(
    dims: tuple[str, ...], shape: tuple[int, ...], coords: Mapping[str, list]
) -> tuple[str, ...]:
    """Return the dimensions of a likelihood's parts: the last ones, features, or else the first."""
    last = dims[len(dims) - len(shape) :]
    return last if shape == tuple(len(coords[dim]) for dim in last) else dims[: len(shape)]


def data_hash(training: ProgramData) -> str:
    """Give a hash of what is explained: the observed values and their coordinates."""
    return values_hash(training.observed())


def versions() -> str:
    """Give the versions of the packages a fit depends on, as JSON."""
    return json.dumps({name: importlib.metadata.version(name) for name in PACKAGES})
