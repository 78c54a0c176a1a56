"""Prior and posterior predictive checks in the terms of people who know motion.

Motions are drawn from the model and measured in the same way as the recorded ones:

    range <joint>   largest minus smallest angle of each degree of freedom, degrees
    period          of the gait, from the spectrum of the angles, s
    foot sliding    mean horizontal speed of the lowest foot joint, m/s
    speed           of the root over the ground, m/s

Before drawing, all sites come from the prior (``prior``), or from the posterior
(``posterior``): there the motion of every training clip is drawn again, given what the
model learned from all of them, with new noise. What the recorded clips are measured on
went through the features too, so that joints the features leave out do not count.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import pandas as pd
import xarray as xr
from arviz_stats.psense import psense_summary
from jaxtyping import Array

from ..errors import InputError
from ..fit import Fit
from ..gp.linalg import cholesky
from ..gp.matrix_normal import GaussianProcess, smooth
from ..inference.draws import stacked
from ..models.multifactor import Multifactor
from ..models.poses import Frames, seen_entries_of
from ..models.starts import cycle
from ..motion.dataset import skeleton_of
from ..motion.joining import split
from ..motion.kinematics import positions
from .diagnostics import varying
from .identified import identified
from .loo import SAMPLE

FEET = re.compile("foot|toe|heel", re.IGNORECASE)


@dataclass(frozen=True)
class Check:
    """Drawn motions beside the recorded ones.

    drawn
        (draw, clip, statistic).
    recorded
        (clip, statistic).
    """

    drawn: xr.DataArray
    recorded: xr.DataArray

    def table(self) -> pd.DataFrame:
        """Give per statistic the mean over clips: recorded, the draws' 5 %, 50 % and 95 %.

        ``below`` is the share of draws below what was recorded; near 0 or 1 the model
        does not make motions like these.
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


def predictive_check(
    fit: Fit, kind: Literal["prior", "posterior"], *, draws: int, seed: int
) -> Check:
    """Draw motions from a model and measure them.

    Parameters
    ----------
    fit
        A fit; for the prior only its model and what its clips look like count.
    kind
        Whether parameters come from the prior or from the posterior.
    draws
        How many times all training clips are drawn.
    seed
        Of the draws.

    Raises
    ------
    InputError
        If the priors are improper, a skeleton does not say how long its unit is, or
        recorded values are missing.
    """
    model, frames = fit.model, fit.training.frames
    if not seen_entries_of(frames).all():
        raise InputError(
            "training clips", "values are missing", "Check a fit of clips that are complete"
        )
    if kind == "prior" and model.priors != "proper":
        raise InputError(
            f"priors {model.priors!r}", "nothing can be drawn from them", "Use priors 'proper'"
        )
    keys = jax.random.split(jax.random.key(seed), draws)
    if kind == "prior":
        y = _prior_draws(model, frames, keys)
    else:
        values, shape = stacked(fit)
        total = shape[0] * shape[1]
        chosen = np.linspace(0, total - 1, draws).round().astype(int)
        picked = {name: value[chosen] for name, value in values.items()}
        y = _posterior_draws(model, frames, picked, keys)
    drawn = xr.concat([_measured(fit, np.asarray(one)) for one in y], dim="draw")
    return Check(drawn, _measured(fit, np.asarray(frames.y)))


def statistics(motion: xr.Dataset) -> dict[str, float]:
    """Measure the motion of one clip; see the module.

    Raises
    ------
    InputError
        If the skeleton does not say how long its unit is.
    """
    skeleton = skeleton_of(motion)
    if skeleton.metres is None:
        raise InputError(
            f"skeleton {skeleton.name!r}", "it does not say how long its unit is", "Set `metres`"
        )
    rate = float(motion.attrs["frame_rate"])
    angle = np.unwrap(motion["angle"].values, axis=0)
    moving = np.ptp(angle, axis=0) > 0
    extent = np.degrees(np.ptp(angle, axis=0))
    dofs = motion["dof"].values[moving]
    ranges = {f"range {dof}": float(e) for dof, e in zip(dofs, extent[moving], strict=True)}
    step, _ = cycle(angle[:, moving], rate)
    where = positions(motion).transpose("frame", "joint", "space") * skeleton.metres
    feet = [name for name in where["joint"].values if FEET.search(str(name))]
    travelled = np.diff(motion["root_position"].values[:, [0, 2]], axis=0) * skeleton.metres
    return {
        **ranges,
        "period": 2.0 * np.pi / (step * rate),
        "foot sliding": _sliding(where.sel(joint=feet).values, rate) if feet else float("nan"),
        "speed": float(np.linalg.norm(travelled, axis=1).mean() * rate),
    }


def prior_sensitivity(fit: Fit) -> pd.DataFrame:
    """Say how much each identified quantity depends on the priors (`psense_summary` of ArviZ).

    Prior and likelihood are raised to powers near one, by importance weights
    (Kallioinen et al. 2023). A quantity that moves with both is where prior and data
    disagree; one that moves with the prior alone is told by the prior.

    Parameters
    ----------
    fit
        A fit with draws and the groups ``log_likelihood`` and ``log_prior``.

    Raises
    ------
    InputError
        If it is a point estimate or has no such groups.
    """
    lacking = [g for g in ("log_likelihood", "log_prior") if g not in fit.tree.children]
    sizes = fit.tree["posterior"].sizes
    if lacking or sizes["chain"] * sizes["draw"] < 2:
        what = f"it has no {' and '.join(lacking)}" if lacking else "it has one draw"
        raise InputError("fit", what, "Fit with --method nuts or ensemble")
    moving, _ = varying(identified(fit).drop_vars("log_likelihood"))
    # Names of features have slashes, which a tree takes for groups.
    names = {f"quantity {i}": name for i, name in enumerate(moving)}
    told = xr.Dataset({key: (SAMPLE, moving[name]) for key, name in names.items()})
    groups = {name: fit.tree[name].to_dataset() for name in ("log_likelihood", "log_prior")}
    table = psense_summary(xr.DataTree.from_dict({"posterior": told, **groups}))
    return table.rename(index=names)


def _measured(fit: Fit, y: np.ndarray) -> xr.DataArray:
    """Decode the features of all training clips and measure each (clip, statistic)."""
    training = fit.training
    clip = np.asarray(training.frames.clip)
    rows = []
    for number, part in enumerate(split(fit.motion).values()):
        motion = training.encoding.motion(
            y[clip == number],
            skeleton_of(part),
            clip=training.clips[number],
            start=part["root_position"].values[0],
            heading=training.encoding.heading(part),
        )
        rows.append(statistics(motion))
    names = [name for name in rows[0] if all(name in row for row in rows)]
    values = np.array([[row[name] for name in names] for row in rows])
    return xr.DataArray(
        values, {"clip": list(training.clips), "statistic": names}, ("clip", "statistic")
    )


def _sliding(feet: np.ndarray, rate: float) -> float:
    """Mean horizontal speed of the foot joint that is lowest, frame by frame."""
    lowest = np.argmin(feet[:-1, :, 1], axis=1)
    moved = np.diff(feet[:, :, [0, 2]], axis=0)[np.arange(len(lowest)), lowest]
    return float(np.linalg.norm(moved, axis=1).mean() * rate)


@partial(jax.jit, static_argnames="model")
def _prior_draws(model: Multifactor, frames: Frames, keys: Array) -> Array:
    """Draw all sites and then the outputs (S, N, D)."""

    def one(key: Array) -> Array:
        sites_key, outputs_key = jax.random.split(key)
        seeded = numpyro.handlers.seed(model.program, sites_key)
        sites = numpyro.handlers.trace(seeded).get_trace(frames)
        values = {n: site["value"] for n, site in sites.items() if n != "y"}
        K = model.covariance(frames, values)
        return GaussianProcess(K, values["scale"]).sample(outputs_key)

    return jax.lax.map(one, keys)


@partial(jax.jit, static_argnames="model")
def _posterior_draws(
    model: Multifactor, frames: Frames, values: Mapping[str, Array], keys: Array
) -> Array:
    """Draw the outputs again given those seen, with new noise (S, N, D)."""
    y = jnp.asarray(frames.y)

    def one(pair: tuple[Mapping[str, Array], Array]) -> Array:
        draw, key = pair
        K = model.covariance(frames, draw, white=False)
        white = jnp.eye(len(y)) / draw["beta"]
        mean, spread = smooth(y, jnp.zeros_like(y), K, white, frames.missing)
        noise = jax.random.normal(key, y.shape)
        factors = jax.vmap(cholesky)(spread + white)
        pattern = jnp.argmax(jnp.asarray(frames.missing.columns), axis=0)
        return mean + jnp.einsum("dnm,md->nd", factors[pattern], noise) / draw["scale"]

    return jax.lax.map(one, (dict(values), keys))
