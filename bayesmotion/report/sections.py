"""The sections of a report, each of any model; what a model does not tell is said in a sentence."""

import json
import warnings
from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr
from arviz_stats.summary import summary

from ..errors import InputError, MotionWarning, NumericalError
from ..evaluate.alignment import aligned
from ..evaluate.checks import predictive_check
from ..evaluate.compare import compare, numbers
from ..evaluate.diagnostics import Diagnosis, scalars, watched
from ..fit import Fit
from ..model import AngleData, Model, RotationInvariant
from ..motion.dataset import clips, label_names
from ..motion.resampling import at_rate
from ..plots.chains import chains_plot
from ..plots.checks import checks_plot
from ..plots.comparison import comparison_plot
from ..plots.latent import styles
from ..plots.latent_space import latent_space
from ..tasks.cautions import cautions
from ..tasks.forecast import Forecast, forecast
from ..tasks.forecast_scores import forecast_picture, forecast_scores
from ..view.viewer import View, view
from .blocks import Block, Frame, Picture, Rows, Section, Sentences, Table

WORST, DRAWN = 12, 4
GHOSTS, PANELS, SITE_ENTRIES = 30, 3, 40
UNITS = {"range": "degrees", "period": "s", "foot sliding": "m/s", "speed": "m/s"}


def what_was_fitted(name: str, fit: Fit) -> Section:
    """Tell the model, its paper, the recordings and the method."""
    attrs = fit.tree.attrs
    pairs = [(what, text) for what, text in fit.summary() if what != "warning"]
    if isinstance(fit.model, Model):
        pairs.insert(0, ("paper", fit.model.about.paper))
        pairs.insert(1, ("made for", fit.model.about.recordings))
    if "clip" in fit.motion.coords:
        names = clips(fit.motion)
        shown = ", ".join(names[:WORST]) + (" ..." if len(names) > WORST else "")
        pairs.append((f"{len(names)} clips", shown))
    for label, levels in fit.labels.items():
        if levels and label != "clip":
            pairs.append((label, ", ".join(levels)))
    versions = ", ".join(f"{k} {v}" for k, v in json.loads(str(attrs["versions"])).items())
    pairs += [("seed", str(attrs["seed"])), ("took", f"{float(attrs['seconds']):.1f} s"),
              ("made with", versions), ("hash of the data", str(attrs["data_hash"]))]  # fmt: skip
    return Section(f"{name}What was fitted to what", (Rows(pairs),))


def convergence(name: str, fit: Fit, found: Diagnosis) -> Section:
    """Tell whether the draws are to be trusted, by what the data can tell."""
    blocks: list[Block] = [Sentences(found.sentences)]
    if found.quantities:
        blocks.append(Table(found.table(WORST), f"The worst of {len(found.quantities)} quantities"))
        draws = scalars(watched(fit), ("chain", "draw"))
        worst = {q.name: draws[q.name] for q in found.quantities[:DRAWN]}
        if next(iter(worst.values())).shape[1] >= DRAWN:
            caption = (
                "Traces of the worst quantities, and how each chain's draws rank among all: "
                "chains that agree stay in the band."
            )
            blocks.append(Picture(chains_plot(worst), caption))
    return Section(f"{name}Convergence, on what the data can tell", tuple(blocks))


def parameters(name: str, fit: Fit) -> Section:
    """Tell the posterior of the sites that have few entries."""
    posterior = aligned(fit)
    most = SITE_ENTRIES * posterior.sizes["chain"] * posterior.sizes["draw"]
    small = [name for name, values in posterior.data_vars.items() if values.size <= most]
    if not small:
        said = "Every site has many entries; they are in the group posterior of the fit."
        return Section(f"{name}Parameters", (Sentences([said]),))
    if fit.point_estimate:
        values = scalars(posterior[small].isel(chain=0, draw=0, drop=True))
        frame = pd.DataFrame({"estimate": {key: float(value) for key, value in values.items()}})
        caption = "The point estimate"
    else:
        frame = pd.DataFrame(summary(posterior[small], kind="stats", round_to="none"))
        caption = "Posterior mean, standard deviation and central interval (ArviZ's summary)"
    frame.index.name = "site"
    return Section(f"{name}Parameters", (Table(frame, caption, ".4g"),))


def latent(name: str, fit: Fit) -> Section:
    """Draw the latent points of a model, by clip and label."""
    posterior = aligned(fit)
    free = fit.model.rotations if isinstance(fit.model, RotationInvariant) else ()
    blocks: list[Block] = []
    for site, values in posterior.data_vars.items():
        of_latent = any(word in str(values.dims[-1]) for word in ("latent", "axis"))
        if values.ndim != 4 or values.shape[-1] < 2 or not (of_latent or site in free):
            continue
        draws = values.transpose("chain", "draw", ...).values
        draws = draws.reshape(-1, *draws.shape[2:])
        turned = " They count up to a rotation; draws are rotated onto each other."
        turned = turned if site in free else ""
        if labels := _labels(fit, values):
            caption = f"{site}: latent points, their mean over draws"
            caption += ", and draws as dots around it." if len(draws) > 1 else "."
            figure = latent_space(draws, labels, paths=labels["clip"])
            blocks.append(Picture(figure, caption + turned))
        else:
            rows = [str(label) for label in values[values.dims[-2]].values]
            caption = (
                f"{site}: the mean vector of each level in the plane that holds most of them, and "
                f"their inner products, which no rotation changes.{turned}"
            )
            figure = styles(draws.mean(axis=0), rows, title=str(site).replace("_", " "))
            blocks.append(Picture(figure, caption))
    if not blocks:
        blocks.append(Sentences(["This model has no latent points of two dimensions or more."]))
    return Section(f"{name}Latent space", tuple(blocks))


def _labels(fit: Fit, site: xr.DataArray) -> dict[str, np.ndarray]:
    """Return the labels of latent points that belong to frames; nothing of others."""
    motion = fit.motion
    if motion.sizes.get("frame") != site.sizes[site.dims[-2]] or "clip" not in motion.coords:
        return {}
    names = ["clip", *(n for n in label_names(motion) if len(set(motion[n].values)) > 1)]
    return {name: motion[name].values.astype(str) for name in names[:PANELS]}


def checks(name: str, fit: Fit, draws: int, seed: int) -> Section:
    """Hold outcomes drawn from the posterior against the recordings, in their units."""
    title = f"{name}Posterior predictive checks"
    try:
        found = predictive_check(fit, "posterior", draws=draws, seed=seed)
    except (InputError, NumericalError) as reason:
        return Section(title, (Sentences([str(reason)]),))
    table = pd.DataFrame(found.table())
    recorded, low, high = (table[c].to_numpy(dtype=float) for c in ("recorded", "5 %", "95 %"))
    statistics = [str(name) for name in table.index]
    outside = [
        name
        for name, inside in zip(statistics, (low <= recorded) & (recorded <= high), strict=True)
        if not inside
    ]
    said = (
        f"New outcomes were drawn {found.drawn.sizes['draw']} times from the model, and measured "
        f"as the recordings were. Of {len(table)} statistics {len(outside)} lie outside the "
        "central 90 % of the draws; a tenth would by chance."
    )
    units = [_unit(name) for name in statistics]
    names = [f"{n} ({unit})" if unit else n for n, unit in zip(statistics, units, strict=True)]
    drawn = found.drawn.mean("clip").sel(statistic=statistics).transpose("draw", "statistic")
    figure = checks_plot(drawn.values, recorded, names)
    table.insert(0, "unit", units)
    return Section(title, (
        Sentences([said, *([f"Outside are {', '.join(outside)}."] if outside else [])]),
        Picture(figure, "What was recorded among what the model draws: blue inside its central "
                        "90 %, vermilion outside."),
        Table(table, "Means over clips: recorded, quantiles of draws, and the share below", ".4g"),
    ))  # fmt: skip


def _unit(statistic: str) -> str:
    return next((unit for word, unit in UNITS.items() if statistic.startswith(word)), "")


def forecasts(
    name: str, fit: Fit, recorded: Mapping[str, xr.Dataset], context: int | None, most: int,
    seed: int,
) -> tuple[Section, list[str], View | None]:  # fmt: skip
    """Forecast clips from their beginnings beside what happened.

    Returns
    -------
    The section, what is not to be believed of it, and the player of the first clip.
    """
    title = f"{name}Forecasts"
    if not isinstance(fit.training, AngleData):
        said = "The model forecasts no motions, of which there would be fans."
        return Section(title, (Sentences([said]),)), [], None
    blocks: list[Block] = []
    messages: list[str] = []
    player, rows = None, {}
    for clip, motion in recorded.items():
        whole, _ = at_rate(motion, fit.frame_rate)
        given = context if context is not None else max(2, whole.sizes["frame"] // 2)
        future = _quiet_forecast(fit, whole, given, most, seed)
        # What is to be said of the fit is said once, for all clips.
        of_fit = cautions(fit)
        messages += [f"{clip}: {text}" for text in future.messages if text not in of_fit]
        score = forecast_scores(fit, whole, future)
        if score is not None:
            cover = score.coverage90
            rows[clip] = {"forecast": score.error, **score.baselines, "90 % held": cover}
        blocks.append(Picture(
            forecast_picture(fit, whole, future),
            f"{clip}: {future.horizon} frames forecast from {given}: median, central 90 % and "
            "what happened, of the angles that move most.",
        ))  # fmt: skip
        if player is None:
            player = view(future, truth=whole, names=["forecast"], draws=GHOSTS, seed=seed,
                          title=f"{clip}: forecast from {given} frames")  # fmt: skip
    if rows:
        frame = pd.DataFrame.from_dict(rows, orient="index").rename_axis("clip")
        frame.columns = [str(column).replace("_", " ") for column in frame.columns]
        caption = (
            "Mean error in radians (norm over the angles), beside simple forecasts, and how often "
            "the 90 % interval held"
        )
        blocks.insert(0, Table(frame, caption))
    return Section(title, tuple(blocks)), messages, player


def _quiet_forecast(fit: Fit, clip: xr.Dataset, context: int, most: int, seed: int) -> Forecast:
    """Return a forecast whose warnings are told on the page."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MotionWarning)
        sizes = fit.tree["posterior"].sizes
        samples = -(-GHOSTS // min(most, sizes["chain"] * sizes["draw"]))
        return forecast(fit, clip, context=context, horizon=clip.sizes["frame"] - context,
                        draws=most, samples=samples, seed=seed)  # fmt: skip


def player(fits: Mapping[str, Fit], shown: View | None) -> Section:
    """Show a forecast moving, or the training clips where nothing is forecast."""
    title = "Seen moving"
    blocks: tuple[Block, ...]
    if shown is None:
        try:
            shown = view(next(iter(fits.values())))
        except InputError as reason:
            return Section(title, (Sentences([str(reason)]),))
        blocks = (Sentences(["The training clips."]), Frame(shown))
    else:
        blocks = (Frame(shown),)
    return Section(title, blocks)


def comparison(fits: Mapping[str, Fit], most: int) -> tuple[Section, list[str]]:
    """Compare fits by what they predict of points left out."""
    title = "Comparison"
    try:
        found = compare(fits, most=most)
    except InputError as reason:
        return Section(title, (Sentences([str(reason)]),)), []
    rows = numbers(found.table)
    frame = pd.DataFrame(rows).set_index("fit")
    caption = (
        "Log predictive density of each point left out (elpd), its difference from the best with "
        "standard errors over points and over clips, and stacking weights"
    )
    return Section(title, (
        Sentences(found.sentences), Table(frame, caption, ".2f"),
        Picture(comparison_plot(rows), "Differences of the elpd from the best fit, with one "
                                       "standard error (the larger one)."),
    )), [text for text in found.sentences if "not to be trusted" in text]  # fmt: skip


def doubts(fit: Fit, found: Diagnosis) -> list[str]:
    """Return what speaks against a fit, in sentences."""
    # That a search has not converged is told by its diagnosis.
    noted = [text.rstrip(".") for text in fit.warnings if "converged" not in text]
    said = [*found.problems, *noted]
    if fit.point_estimate:
        said.append("it is a point estimate: its intervals leave out how unsure the parameters are")
    return list(dict.fromkeys(said))
