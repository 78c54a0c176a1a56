"""Whether a tree is a fit: asked of files, which anybody may have written."""

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jax.core import Tracer
from numpyro import handlers

from .errors import InputError, NumericalError
from .motion.validation import require_motion
from .netcdf import values_hash

if TYPE_CHECKING:
    from .fit import Fit

MEND = "Get the file again, or fit again"
GROUPS = ("posterior", "sample_stats", "log_prior", "observed_data", "constant_data", "motion")
SAMPLE = ("chain", "draw")
# JSON in the attributes of every fit, and what it holds; `reading` is of the command line.
TABLES: Mapping[str, type] = {"model": dict, "settings": dict, "versions": dict, "warnings": list}
# Recordings are prepared again when they are loaded: equal but for the last digits.
TOLERANCE = 1e-6


def require_tree(tree: xr.DataTree, where: object) -> None:
    """Refuse a tree without the groups and attributes of a fit, or with values of other kinds.

    Parameters
    ----------
    tree
        Of a file.
    where
        The file, for the error.

    Raises
    ------
    InputError
        If it is none, or the values explained are not those of its hash.
    """
    missing = [name for name in GROUPS if name not in tree.children]
    missing += [name for name in ("inference", "seed", "seconds", "data_hash", *TABLES)
                if name not in tree.attrs]  # fmt: skip
    if missing:
        raise InputError(where, f"{', '.join(missing)} missing", MEND)
    for name, kind in {**TABLES, "reading": dict}.items():
        text = tree.attrs.get(name, "{}")
        try:
            right = isinstance(json.loads(str(text)), kind)
        except (ValueError, RecursionError):
            right = False
        if not right:
            raise InputError(where, f"its attribute {name} is damaged", MEND)
    for name in ("posterior", "sample_stats", "log_prior"):
        group = tree[name].to_dataset()
        for site, array in group.data_vars.items():
            if array.dims[:2] != SAMPLE or array.dtype.kind not in "fiub":
                raise InputError(where, f"{name}/{site} is not numbers of draws", MEND)
        if name != "log_prior" and not (group.data_vars and all(map(group.sizes.get, SAMPLE))):
            raise InputError(where, f"{name} holds no draws", MEND)
        drawn = tree["posterior"].sizes
        if group.data_vars and any(group.sizes.get(d) != drawn.get(d) for d in SAMPLE):
            raise InputError(where, f"{name} has other draws than the posterior", MEND)
    if values_hash(tree["observed_data"].to_dataset()) != tree.attrs["data_hash"]:
        raise InputError(where, "the values explained are not those that were fitted", MEND)
    motion = tree["motion"].to_dataset()
    if "skeletons" in motion.attrs:
        require_motion(motion, where)


def require_draws(fit: "Fit", where: object) -> None:
    """Refuse a fit whose draws or recordings are not such as its model has.

    Raises
    ------
    InputError
        If the model cannot have been fitted to these recordings, a site is missing, has another
        shape, is not finite or lies where its distribution has no density.
    """
    try:
        training = fit.training
        observed = training.observed()
        sites = _sites(fit.model, training.data)
    except InputError:
        raise
    # What a model makes of recordings that were never its own can be anything.
    except (
        ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RuntimeError,
        NumericalError,
    ) as error:  # fmt: skip
        told = str(error).split("\n")[0]
        raise InputError(
            where, f"its recordings are none of the model {fit.model.name!r} ({told})", MEND
        ) from error
    _require_same(observed, fit.tree["observed_data"].to_dataset(), where)
    posterior = fit.tree["posterior"].to_dataset()
    for name, (shape, support) in sites.items():
        if name not in posterior:
            if support is None:
                continue
            raise InputError(where, f"it has no draws of {name}", MEND)
        values = posterior[name].values
        if values.shape[2:] != shape:
            raise InputError(
                where, f"{name} has the shape {values.shape[2:]}, the model's has {shape}", MEND
            )
        if support is not None and not _supported(values, support):
            raise InputError(where, f"{name} holds values that it cannot have", MEND)


def _require_same(prepared: xr.Dataset, stored: xr.Dataset, where: object) -> None:
    for name, array in prepared.data_vars.items():
        same = name in stored and stored[name].shape == array.shape
        if same and array.dtype.kind in "fiub":
            there, here = stored[name].values.astype(float), array.values.astype(float)
            same = np.allclose(there, here, TOLERANCE, TOLERANCE, equal_nan=True)
        if not same:
            raise InputError(where, f"its recordings are not those that were fitted ({name})", MEND)


def _sites(model: Any, data: tuple) -> dict[str, tuple[tuple[int, ...], Any]]:
    """Return shape and support of a program's unobserved sites, None of what they determine."""
    sites: dict[str, tuple[tuple[int, ...], Any]] = {}

    def run(data: tuple) -> None:
        program = handlers.seed(model.program, jax.random.key(0))
        for name, site in handlers.trace(program).get_trace(*data).items():
            if site["type"] == "deterministic":
                sites[name] = (jnp.shape(site["value"]), None)
            elif site["type"] == "sample" and not site["is_observed"]:
                sites[name] = (jnp.shape(site["value"]), site["fn"].support)

    # Nothing is computed: shapes are all that is asked for.
    jax.eval_shape(run, data)
    return sites


def _supported(values: np.ndarray, support: Any) -> bool:
    """Whether all values are finite and in the support, where that is the same for all draws."""
    if not np.isfinite(values).all():
        return False
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(support)):
        return True
    # NumPyro asks it of NumPy arrays as well, for which nothing is compiled.
    return bool(np.all(support(values)))
