"""Prior and posterior predictive checks, and how much priors matter, for any model.

Outcomes are drawn from the model and measured in the same way as the recorded ones:

    <site> mean, sd, smallest, largest   over rows and features, in the model's own units
    <site> change                        root mean square change from row to row of a clip

and where a model's data can be made motions again (`model.MotionData`) also in the terms of
the trade, see `motion_statistics`. Entries that were not recorded are not counted in drawn
outcomes either; what motions are measured on went through the model's features, so that
joints that these leave out do not count.

``prior``      all sites and outcomes are drawn together from the program (`SBCCase.draw`,
               which is exact by contract).
``posterior``  for every draw theta of all sites new outcomes y' ~ p(y | theta), from the
               program's own observed sites.

The second is the honest replicate: it sees the recordings through theta alone. Conditioning
on the recordings once more (`Model.predict` given what is seen) would draw them nearly as
they are, whatever the model. Where a model integrates functions out, as Gaussian processes
do, theta has no function in it, and y' has a new one: replicates are like the recordings in
kind, not frame by frame. Entries one at a time, given all others, are checked by LOO-PIT
(`leave_one_out` with ``by="entry"``).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import xarray as xr
from arviz_stats.psense import psense_summary
from jaxtyping import Array, Key
from numpyro import handlers
from numpyro.distributions import Unit

from ..errors import InputError
from ..fit import Fit
from ..inference.densities import require_densities
from ..inference.draws import draw_keys, one_by_one, stacked, thinned
from ..inference.pointwise import SAMPLE
from ..inference.predicting import require_model
from ..model import Model, MotionData, SBCCase, draw_sites
from ..motion.joining import split
from ..programs import one_at_a_time
from .diagnostics import varying
from .identified import identified
from .motion_statistics import statistics

DRAWS = 100
# All rows of recordings without clips.
WHOLE = "all"


@dataclass(frozen=True, repr=False)
class Check:
    """Drawn outcomes beside the recorded ones.

    kind
        ``prior`` or ``posterior``.
    drawn
        (draw, clip, statistic).
    recorded
        (clip, statistic).
    """

    kind: str
    drawn: xr.DataArray
    recorded: xr.DataArray

    def table(self) -> pd.DataFrame:
        """Return per statistic the mean over clips: recorded, the draws' 5 %, 50 % and 95 %.

        ``below`` is the share of draws below what was recorded; near 0 or 1 the model
        does not make outcomes like these.
        """
        drawn, recorded = self.drawn.mean("clip"), self.recorded.mean("clip")
        quantiles = drawn.quantile([0.05, 0.5, 0.95], dim="draw")
        return pd.DataFrame(
            {
                "recorded": recorded.values,
                "5 %": quantiles.sel(quantile=0.05).values,
                "50 %": quantiles.sel(quantile=0.5).values,
                "95 %": quantiles.sel(quantile=0.95).values,
                "below": (drawn < recorded).mean("draw").values,
            },
            index=pd.Index(recorded["statistic"].values, name="statistic"),
        )

    def __repr__(self) -> str:
        """Return the table as text."""
        table = self.table().to_string(float_format=lambda value: f"{value:.3f}")
        return f"{self.kind} predictive check, {self.drawn.sizes['draw']} draws\n{table}"

    def _repr_html_(self) -> str:
        """Return the table as notebooks show it."""
        head = f"<b>{self.kind} predictive check, {self.drawn.sizes['draw']} draws</b>"
        return head + self.table().to_html(float_format=lambda value: f"{value:.3f}")


@one_at_a_time
def predictive_check(fit: Fit, kind: str, *, draws: int = DRAWS, seed: int = 0) -> Check:
    """Draw outcomes from a model and measure them beside the recorded ones.

    Parameters
    ----------
    fit
        A fit of any model; for the prior only its model and the shape of its recordings count.
    kind
        ``prior`` or ``posterior``: where parameters come from.
    draws
        At most so many draws of the recordings; of a posterior evenly spread ones, of a point
        estimate all from its one.
    seed
        Of the draws.

    Raises
    ------
    InputError
        If the model has no density that can be drawn from.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> check = bm.predictive_check(fit, "posterior", draws=50)  # doctest: +SKIP
    """
    _require_kind(kind)
    drawn = _prior(fit, draws, seed)[1] if kind == "prior" else _posterior(fit, draws, seed)
    observed = fit.training.observed()
    recorded = {str(name): array.values for name, array in observed.data_vars.items()}
    count = len(next(iter(drawn.values())))
    measured = [
        _measured(fit, observed, {n: np.where(np.isfinite(y), drawn[n][i], np.nan)
                                  for n, y in recorded.items()})
        for i in range(count)
    ]  # fmt: skip
    # What the recordings do not tell, such as the change from row to row of one row, is left out.
    known = _measured(fit, observed, recorded).dropna("statistic", how="all")
    # A joint that a draw does not move has no range there: what is compared is what was recorded.
    each = [one.reindex_like(known) for one in measured]
    return Check(kind, xr.concat(each, dim="draw"), known)


@one_at_a_time
def predictive_groups(
    fit: Fit, kinds: tuple[str, ...] = ("prior", "posterior"), *, draws: int = DRAWS, seed: int = 0
) -> xr.DataTree:
    """Return a fit's tree with ArviZ's groups of what the model draws.

    ``prior`` and ``prior_predictive`` (one chain), ``posterior_predictive`` (the fit's chains,
    evenly spread draws), for `az.plot_prior_posterior`, `az.plot_ppc_dist` and the like.
    What is drawn: see the module. Entries that were not recorded are drawn too.

    Parameters
    ----------
    fit
        A fit of any model.
    kinds
        Which of them: ``prior``, ``posterior``.
    draws
        At most so many of each.
    seed
        Of the draws.

    Raises
    ------
    InputError
        If the model has no density that can be drawn from.
    """
    tree = fit.tree.copy()
    for kind in kinds:
        _require_kind(kind)
    if "prior" in kinds:
        sites, outcomes = _prior(fit, draws, seed)
        posterior = fit.tree["posterior"].to_dataset()
        tree["prior"] = xr.DataTree(_like(posterior, sites, (1, draws), 2))
        tree["prior_predictive"] = xr.DataTree(
            _like(fit.training.observed(), outcomes, (1, draws), 0)
        )
    if "posterior" in kinds:
        outcomes, sizes = _posterior(fit, draws, seed), thinned(fit, draws).sizes
        shape = (1, draws) if fit.point_estimate else (sizes["chain"], sizes["draw"])
        tree["posterior_predictive"] = xr.DataTree(
            _like(fit.training.observed(), outcomes, shape, 0)
        )
    return tree


def prior_sensitivity(fit: Fit) -> pd.DataFrame:
    """Return how much each identified quantity depends on the priors (`psense_summary` of ArviZ).

    Prior and likelihood are raised to powers near one, by importance weights
    (Kallioinen et al. 2023). A quantity that moves with both is where prior and data
    disagree; one that moves with the prior alone is told by the prior. The likelihood is the
    joint one, p(y | theta): the conditional densities of points that leave-one-out asks for
    do not add up to it under a Gaussian process.

    Parameters
    ----------
    fit
        A fit with draws and the groups ``joint_log_likelihood`` and ``log_prior``.

    Raises
    ------
    InputError
        If it is a point estimate or has no such groups.
    """
    groups = {"log_likelihood": "joint_log_likelihood", "log_prior": "log_prior"}
    lacking = [g for g in groups.values() if g not in fit.tree.children]
    if lacking or fit.point_estimate:
        what = f"it has no {' and '.join(lacking)}" if lacking else "it has one draw"
        raise InputError("fit", what, "Fit with method nuts or ensemble")
    moving, _ = varying(identified(fit).drop_vars("log_likelihood"))
    # Names of features have slashes, which a tree takes for groups.
    names = {f"quantity {i}": name for i, name in enumerate(moving)}
    told = xr.Dataset({key: (SAMPLE, moving[name]) for key, name in names.items()})
    parts = {name: fit.tree[group].to_dataset() for name, group in groups.items()}
    table = psense_summary(xr.DataTree.from_dict({"posterior": told, **parts}))
    return table.rename(index=names)


def _require_kind(kind: str) -> None:
    if kind not in ("prior", "posterior"):
        raise InputError(f"kind {kind!r}", "there is no such check", "Use 'prior' or 'posterior'")


def _prior(fit: Fit, draws: int, seed: int) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Draw all sites, and the outcomes, from the program (S, ...)."""
    model = require_model(fit)
    case, _ = model.sbc_case()
    keys = jax.random.split(jax.random.key(seed), draws)
    require_densities(handlers.seed(model.program, keys[0]), fit.training.data)
    sites, outcomes = one_by_one(partial(_prior_draw, model, case), keys, fit.training.data[0])
    _require_sites(fit, outcomes)
    broken = [name for name, value in outcomes.items() if not np.all(np.isfinite(value))]
    if broken:
        raise InputError(
            f"prior of {model.name}", f"draws of {broken[0]} are not finite",
            "Use priors that are proper",
        )  # fmt: skip
    return sites, outcomes


def _posterior(fit: Fit, draws: int, seed: int) -> dict[str, np.ndarray]:
    """Draw the outcomes given each of the fit's draws (S, ...); of a point so many times."""
    model = require_model(fit)
    values, _ = stacked(fit, draws)
    data, keys = fit.training.data[0], draw_keys(seed, values)
    if fit.point_estimate:
        values = {name: jnp.repeat(value, draws, axis=0) for name, value in values.items()}
        keys = jax.random.split(keys[0], draws)
    names = tuple(map(str, fit.training.observed().data_vars))
    try:
        outcomes = one_by_one(partial(_outcome, model, names), (dict(values), keys), data)
    except NotImplementedError as error:
        raise _no_draws(model) from error
    _require_sites(fit, outcomes)
    return outcomes


def _require_sites(fit: Fit, outcomes: Mapping[str, np.ndarray]) -> None:
    for name in fit.training.observed().data_vars:
        if name not in outcomes:
            raise _no_draws(fit.model)


def _no_draws(model: Any) -> InputError:
    return InputError(
        f"model {model.name!r}",
        "its outcomes have no density that can be drawn from",
        "Check a model whose observed sites are distributions",
    )


@partial(jax.jit, static_argnames=("model", "case"))
def _prior_draw(
    model: Model, case: SBCCase, key: Key[Array, ""], data: Any
) -> tuple[dict[str, Array], dict[str, Array]]:
    values, drawn = case.draw(model, key, data)
    program = handlers.substitute(handlers.seed(model.program, key), data=dict(values))
    sites = handlers.trace(program).get_trace(drawn)
    return dict(values), {
        name: jnp.asarray(site["value"])
        for name, site in sites.items()
        if site["type"] == "sample" and site["is_observed"] and not isinstance(site["fn"], Unit)
    }


@partial(jax.jit, static_argnames=("model", "names"))
def _outcome(
    model: Model,
    names: tuple[str, ...],
    draw_and_key: tuple[Mapping[str, Array], Key[Array, ""]],
    data: Any,
) -> dict[str, Array]:
    draw, key = draw_and_key
    sites = draw_sites(model, key, data, draw)
    return {name: sites[name] for name in names if name in sites}


def _like(
    example: xr.Dataset, values: Mapping[str, np.ndarray], shape: tuple[int, int], skip: int
) -> xr.Dataset:
    """Put values (S, ...) into the form of a data set's variables, without their first dims."""
    arrays = {
        str(name): ((*SAMPLE, *array.dims[skip:]),
                    np.asarray(values[str(name)]).reshape(*shape, *array.shape[skip:]))
        for name, array in example.data_vars.items()
        if str(name) in values
    }  # fmt: skip
    labels = {n: c for n, c in example.coords.items() if n not in SAMPLE}
    used = {dim for dims, _ in arrays.values() for dim in dims}
    coords = {n: c for n, c in labels.items() if set(c.dims) <= used}
    sample = {"chain": np.arange(shape[0]), "draw": np.arange(shape[1])}
    return xr.Dataset(arrays, {**coords, **sample})


def _measured(fit: Fit, observed: xr.Dataset, values: Mapping[str, np.ndarray]) -> xr.DataArray:
    """Measure outcomes, NaN where they do not count (clip, statistic)."""
    found: dict[str, dict[str, float]] = {}
    for name, y in values.items():
        for clip, rows in _clips(fit, observed[name]):
            found.setdefault(clip, {}).update(_site_statistics(name, y[rows]))
    if isinstance(fit.training, MotionData):
        for clip, motion in split(fit.training.to_motion(values)).items():
            found.setdefault(clip, {}).update(statistics(motion))
    names = list(dict.fromkeys(name for each in found.values() for name in each))
    table = [[each.get(name, np.nan) for name in names] for each in found.values()]
    coords = {"clip": list(found), "statistic": names}
    return xr.DataArray(np.array(table), coords, ("clip", "statistic"))


def _clips(fit: Fit, site: xr.DataArray) -> Iterator[tuple[str, np.ndarray]]:
    """Return which rows of a site are which clip's; all of them where there are none."""
    points = require_model(fit).points(fit.training)
    if "clip" in site.coords and site["clip"].dims == site.dims[:1]:
        clip = site["clip"].values
    elif "clip" in points and len(points["clip"][1]) == len(site):
        clip = np.asarray(points["clip"][1])
    else:
        clip = np.full(len(site), WHOLE)
    for name in dict.fromkeys(clip.tolist()):
        yield str(name), np.flatnonzero(clip == name)


def _site_statistics(name: str, y: np.ndarray) -> dict[str, float]:
    there, change = y[np.isfinite(y)], np.diff(y, axis=0)
    change = change[np.isfinite(change)]
    nothing = float("nan")
    return {
        f"{name} mean": float(there.mean()) if there.size else nothing,
        f"{name} sd": float(there.std()) if there.size else nothing,
        f"{name} smallest": float(there.min()) if there.size else nothing,
        f"{name} largest": float(there.max()) if there.size else nothing,
        f"{name} change": float(np.sqrt(np.mean(change**2))) if change.size else nothing,
    }


__all__ = ["Check", "predictive_check", "predictive_groups", "prior_sensitivity", "statistics"]
