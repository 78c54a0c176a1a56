"""The contract that every model keeps: one function that tries all its verbs.

What is promised of a model is tried on its own example: the shapes and names of what each
verb returns, that prior draws are finite, that a fit is saved and loaded to the last bit,
that predictions average over draws whatever their order, that missing entries are left out,
that leave-one-out and the diagnosis of draws work, and that every setting changes something.
"""

import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array
from numpyro import handlers

from ..errors import InputError, MotionWarning
from ..fit import Fit, load
from ..inference.density import sites_of
from ..inference.draws import stacked, unstacked
from ..inference.methods import MAP, NUTS, fit
from ..inference.modes import log_densities, trained_model
from ..inference.predicting import Prediction, predict, require_model
from ..model import Data, Model, SBCCase
from ..prediction import Predictive
from ..registry import build_model, describe_model
from .checks import predictive_check
from .compare import compare
from .diagnostics import diagnose
from .identified import identified
from .loo import leave_one_out
from .sbc.controls import shifted

SAME_ORDER = 1e-9
PREDICTED = 8  # draws


def check_model(kind: type, *, draws: int = 50, seed: int = 0) -> list[str]:
    """Try every verb of a model on its example.

    Parameters
    ----------
    kind
        The class of the model.
    draws
        Draws and warm-up iterations of two chains; of much fewer a chain may stand still, and
        there is no leaving out by its draws.
    seed
        Of the example and of all that is random.

    Returns
    -------
    What has been tried, in sentences.

    Raises
    ------
    InputError
        If the model breaks the contract: which verb, how, and what it should return.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> done = bm.check_model(bm.Multifactor)  # doctest: +SKIP
    """
    return list(_tried(kind, draws, seed))


def _tried(kind: Any, draws: int, seed: int) -> Iterator[str]:
    model, recordings = kind.example(seed)
    _require(isinstance(model, Model), kind, "it lacks verbs", "see `bayesmotion.model.Model`")
    _require(
        build_model(describe_model(model), kind.name) == model,
        kind, "its settings do not come back from plain values", "see `bayesmotion.settings`",
    )  # fmt: skip
    data = model.prepare(recordings)
    _require(isinstance(data, Data), kind, "prepare does not return Data", "see `model.Data`")
    yield "settings and data"
    _check_prior(model, data)
    yield "every observed site is sampled, and all dimensions have names"
    with warnings.catch_warnings():
        # So few draws are not to be trusted, which is not the point here.
        warnings.simplefilter("ignore", MotionWarning)
        mode = fit(model, recordings, method=_quick_point(model), seed=seed)
        sampled = _sampled(model, recordings, draws, seed)
    _check_tree(model, data, mode)
    yield "a point estimate"
    _check_parts(mode)
    yield "all parts together are the log density of the program"
    # How many draws there are is not a model's matter, and compiles all of it anew.
    _check_fit(mode if sampled is None else sampled, recordings)
    yield "saving, loading, predictions averaged over draws, identified quantities, leave-one-out"
    if sampled is not None:
        _check_parts(sampled)
        _check_comparison({"point": mode, "draws": sampled})
        yield "draws beside the point estimate"
    _check_settings(model)
    yield "settings are plain values"
    if _check_case(model):
        predictive_check(mode, "prior", draws=2)
        yield "the calibration case, and outcomes drawn from the prior"
    else:
        for name, value in _prior_draw(model, jax.random.key(1), data.data).items():
            _require(bool(jnp.all(jnp.isfinite(value))), model,
                     f"a prior draw of {name} is not finite", "give it a proper prior")  # fmt: skip
        yield "prior draws are finite"


def _require(holds: bool, kind: Any, what: str, mend: str) -> None:
    if not holds:
        raise InputError(f"model {getattr(kind, 'name', kind)!r}", what, mend)


def _quick_point(model: Any) -> Any:
    """Return the model's default method if it gives a point, with few steps where it has them."""
    first = model.about.methods[0]
    return MAP(initial=1, keep=1, max_steps=100) if first in ("map", "nuts", "ensemble") else first


def _sampled(model: Any, recordings: xr.Dataset, draws: int, seed: int) -> Fit | None:
    if "nuts" not in model.about.methods:
        return None
    # Chains begin about the mode and in its units: they move without longer trees.
    method = NUTS(draws=draws, warmup=draws, chains=2, max_tree_depth=4)
    return fit(model, recordings, method=method, seed=seed)


def _check_prior(model: Any, data: Data) -> None:
    program = handlers.seed(handlers.uncondition(model.program), jax.random.key(1))
    sites = sites_of(program, data.data)
    drawn = {n: s["value"] for n, s in sites.items() if s["type"] == "sample"}
    for name in data.observed().data_vars:
        _require(name in drawn, model, f"the program does not sample {name}",
                 "sample every variable of Data.observed")  # fmt: skip
    dims, coords = model.dims(), model.coords(data)
    for name, value in drawn.items():
        _require(name in dims and len(dims[name]) == jnp.ndim(value), model,
                 f"dims() does not name the dimensions of {name}", "add them")  # fmt: skip
        for dim in dims[name]:
            _require(dim in coords, model, f"coords() lacks {dim!r}", "add its labels")


@partial(jax.jit, static_argnames="model")
def _prior_draw(model: Any, key: Array, data: tuple) -> dict[str, Array]:
    program = handlers.seed(handlers.uncondition(model.program), key)
    sites = handlers.trace(program).get_trace(*data)
    return {n: jnp.asarray(s["value"]) for n, s in sites.items() if s["type"] == "sample"}


def _check_tree(model: Any, data: Data, mode: Fit) -> None:
    for group in ("posterior", "log_likelihood", "log_prior", "observed_data", "constant_data"):
        _require(group in mode.tree.children, model, f"the fit has no group {group}", "add it")
    found = set(mode.tree["joint_log_likelihood"].data_vars)
    _require(found == set(data.observed().data_vars), model,
             f"the log likelihood has {sorted(map(str, found))}",
             "observed sites need a density: a factor has none")  # fmt: skip
    labels = model.coords(data)
    for group in ("posterior", "joint_log_likelihood"):
        for name, site in mode.tree[group].data_vars.items():
            named = all(site.sizes[dim] == len(labels[dim]) for dim in site.dims[2:])
            _require(named, model, f"the dimensions of {name} are not as long as their labels",
                     "mend coords()")  # fmt: skip
    coords, rows = model.points(data), mode.tree["log_likelihood"].sizes["point"]
    _require(all(dim == "point" and len(value) >= rows for dim, value in coords.values()), model,
             "points() does not label pointwise()", "give coordinates along 'point'")  # fmt: skip


def _check_parts(trained: Fit) -> None:
    """Add up the parts of every draw: each belongs to one site, and none is lacking."""
    groups = (trained.tree[name].to_dataset() for name in ("joint_log_likelihood", "log_prior"))
    parts = [part for group in groups for part in group.data_vars.values()]
    total = np.sum([part.sum(part.dims[2:]).values for part in parts], axis=0)
    if trained.tree.attrs["inference"] == "map":
        # What the search climbed.
        whole = trained.tree["sample_stats"].to_dataset()["lp"].values
    else:
        values, shape = stacked(trained)
        whole = unstacked(log_densities(trained.model, trained.training.data, values), shape)
    _require(np.allclose(total, whole, rtol=SAME_ORDER), trained.model,
             "the parts of its log density do not add up to it",
             "let log_prob_parts() of its distributions add up to log_prob()")  # fmt: skip


def _check_fit(trained: Fit, recordings: xr.Dataset) -> None:
    """Try what a fit promises, of a point or of draws."""
    model = trained.model
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fit.nc"
        trained.save(path)
        again = load(path)
    before, after = (one.tree["posterior"].to_dataset() for one in (trained, again))
    same = again.model == model and after.identical(before)
    _require(same and again.tree.attrs == trained.tree.attrs, model, "a loaded fit is another",
             "keep settings plain and draws numbers")  # fmt: skip
    first, second, third = (
        predict(one, recordings, draws=PREDICTED)
        for one in (trained, again, Fit(model, trained.motion, _reversed(trained.tree)))
    )
    _require(_difference(first, second) == 0.0, model, "a loaded fit predicts otherwise",
             "keep all that prediction needs in settings, recordings and sites")  # fmt: skip
    _require(_difference(first, third) < SAME_ORDER, model,
             "the order of draws changes a prediction", "average over draws")  # fmt: skip
    for name, mixture in first.sites.items():
        shape = trained.training.observed()[name].shape
        _require(mixture.means().shape == shape, model, f"the prediction of {name} has shape "
                 f"{mixture.means().shape}", f"return {shape}, as observed")  # fmt: skip
    _check_predictive(trained, recordings)
    found = identified(trained)
    _require(all(np.all(np.isfinite(v.values)) for v in found.data_vars.values()), model,
             "an identified quantity is not finite", "mend identified()")  # fmt: skip
    points = leave_one_out(trained)["log_likelihood"].to_dataset()["y"]
    _require(
        bool(np.all(np.isfinite(points.values))), model, "pointwise() is not finite", "mend it"
    )
    diagnose(trained)
    drawn = predictive_check(trained, "posterior", draws=2).drawn
    _require(drawn.size > 0, model, "no outcomes are drawn", "sample every observed site")


def _check_comparison(fits: dict[str, Fit]) -> None:
    table = compare(fits).table
    _require(
        set(table.index) == set(fits) and bool(np.all(np.isfinite(table["elpd"]))),
        fits["draws"].model, "its fits are not compared", "mend pointwise()",
    )  # fmt: skip


def _check_case(model: Any) -> bool:
    """Draw from the calibration case; False where the model says that it has none."""
    try:
        case, data = model.sbc_case()
    except InputError:
        return False
    values, found = _case_draw(case, jax.random.key(2), data)
    for name, value in values.items():
        _require(bool(jnp.all(jnp.isfinite(value))), model, f"{name} of sbc_case() is not finite",
                 "draw from proper priors")  # fmt: skip
    for name in (case.prior, *(site for site, _ in case.noise)):
        _require(name in values, model, f"sbc_case() names {name}, which is not drawn",
                 "name sites of the program")  # fmt: skip
    for name, value in found.items():
        _require(bool(jnp.all(jnp.isfinite(value))), model, f"quantity {name} is not finite",
                 "mend the quantities of sbc_case()")  # fmt: skip
    return True


@partial(jax.jit, static_argnames="case")
def _case_draw(case: SBCCase, key: Array, data: Any) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return a draw of a case and its quantities; try the controls, for the form alone."""
    values, seen = case.draw(case.model, key, data)
    like = jax.tree.structure(seen)
    for spoilt in (case.shuffle(key, seen), shifted(case, data, seen)):
        _require(jax.tree.structure(spoilt) == like, case.model,
                 "a control of sbc_case() changes the form of the data",
                 "return data with other outcomes")  # fmt: skip
    return dict(values), dict(case.quantities(case.model, seen, values))


def _check_predictive(trained: Fit, recordings: xr.Dataset) -> None:
    model, data = require_model(trained), trained.training.data
    new = model.prepare(recordings, trained.training)
    values = {name: jnp.asarray(value) for name, value in trained.values().items()}

    # Traced, not computed: what it is of is all that is asked.
    def look_at_state(frames: Any, values: Any) -> None:
        state = model.condition(frames, values)
        arrays = all(isinstance(leaf, Array | np.ndarray) for leaf in jax.tree.leaves(state))
        _require(arrays, model, "condition() returns no pytree of arrays",
                 "return a NamedTuple of arrays")  # fmt: skip

    def look_at_prediction(state: Any, frames: Any, own: Any) -> None:
        for name, each in model.predict(state, frames, own).items():
            _require(isinstance(each, Predictive), model, f"predict() of {name} is no Predictive",
                     "return one of `bayesmotion.prediction`")  # fmt: skip

    jax.eval_shape(look_at_state, data[0], values)
    state = trained_model(model, data[0], values)
    own = model.initial_values(new, 0, 1, state)[0]
    jax.eval_shape(look_at_prediction, state, new.data[0], own)


def _check_settings(model: Any) -> None:
    for field in fields(model):
        value = getattr(model, field.name)
        _require(hash(value) is not None, model, f"setting {field.name} is not hashable",
                 "settings are numbers, texts, tuples and small frozen dataclasses")  # fmt: skip


def _reversed(tree: xr.DataTree) -> xr.DataTree:
    """Return the tree with its draws in reverse order."""
    out = tree.copy()
    posterior = tree["posterior"].to_dataset().isel(draw=slice(None, None, -1))
    out["posterior"] = xr.DataTree(posterior)
    return out


def _difference(first: Prediction, second: Prediction) -> float:
    """Largest difference of mean and standard deviation, in standard deviations."""
    worst = 0.0
    for name, one in first.sites.items():
        other = second.sites[name]
        scale = np.maximum(one.sds(), 1e-12)
        for a, b in ((one.means(), other.means()), (one.sds(), other.sds())):
            worst = max(worst, float(np.max(np.abs(a - b) / scale)))
    return worst
