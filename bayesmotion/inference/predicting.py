"""Predictions for new recordings, averaged over all draws of a fit.

New recordings y* have unknowns u of their own (a phase, a style, a latent path). For every
draw theta of the trained model

    p(y* | theta) = int p(y* | u, theta) p(u | y*_seen, theta) du,

and a prediction is the mean of that over the draws: a mixture. The posterior of u is taken
at its modes, which are found from many initial values for the draw of highest density, and
followed from there for every other draw; modes count by the mass about them (Laplace),

    w_k ~ p(u_k, y*_seen | theta) |H_k|^(-1/2).

Of a model that integrates over them (`model.IntegratesUnknowns`) u is then drawn about every
mode: of `CANDIDATES` times as many draws u_l ~ N(u_k, H_k^-1) some are chosen by their importance

    w_l ~ p(u_l, y*_seen | theta) / N(u_l; u_k, H_k^-1),

cut off at sqrt(L) times their mean (Ionides 2008): what the context leaves open of a pace or a
style widens the prediction. Of other models the modes alone are taken.

What is not seen of recordings is NaN in them: context frames are followed by frames of NaN,
missing limbs are columns of NaN. A point estimate is the case of one draw.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Array, Bool, Float, Int
from scipy.special import logsumexp

from ..errors import InputError
from ..fit import Fit
from ..gp.linalg import require_finite
from ..model import (
    Data,
    InfersFromContext,
    IntegratesUnknowns,
    Model,
    MotionData,
)
from ..prediction import (
    BernoulliEntries,
    BernoulliMixture,
    Mixture,
    NormalEntries,
    mixture_of,
)
from ..programs import one_at_a_time, require_memory
from ..seeds import require_seed
from .about_modes import Counts, predict_one
from .draws import draw_keys, one_by_one, stacked
from .modes import NEGLIGIBLE, find_modes, trained_model
from .optimisation.optimise import SMALLER

DRAWS, MODES = 100, 4
SEARCH_STEPS = 400
# Modes that predict the same are one too, such as those of vectors of which only products
# count, turned round: the largest difference, of the standard deviation in training.
ALIKE = 0.05
# Of a distribution that is itself a mixture, so many parts in all, over all draws.
MIXTURES = 32


@dataclass(frozen=True)
class Prediction:
    """What a fit says of every entry of recordings, seen or not.

    data
        The recordings as the model sees them.
    sites
        For every observed site a mixture over draws (and modes), in the recordings' units.
    samples
        For every observed site joint draws (J, N, D) in these units: of the components one after
        the other, of each as many.
    weight
        (K,) of the components.
    log_evidence
        log p(y_seen | training data): the mean over the draws of the density of what is seen,
        the recordings' own unknowns integrated out about their modes; per draw (S,).
    unknowns
        The recordings' own unknowns (K, ...), component by component.
    trained
        Site values (S, ...) of the fit's draws that were used.
    draw
        (K,) of which of these a component is.
    of
        How many draws the fit has.
    inference
        How the fit was made: for a point estimate the intervals leave out how unsure the
        trained model is.
    mode
        The recordings' own unknowns at the mode of most weight.
    mode_draw
        Which of the draws that mode is of.
    """

    data: Data
    sites: dict[str, Mixture | BernoulliMixture]
    samples: dict[str, Float[np.ndarray, "j n d"]]
    weight: Float[np.ndarray, " k"]
    log_evidence: Float[np.ndarray, " s"]
    unknowns: dict[str, np.ndarray]
    trained: Mapping[str, Array]
    draw: Int[np.ndarray, " k"]
    of: int
    inference: str
    mode: dict[str, np.ndarray]
    mode_draw: int

    @property
    def draws(self) -> int:
        """How many of the fit's draws were used."""
        return len(self.log_evidence)

    def site(self, name: str | None = None) -> Mixture | BernoulliMixture:
        """Return the mixture of an observed site, of the only one where there is one.

        Raises
        ------
        InputError
            If there is no such site, or several and none is named.
        """
        names = ", ".join(self.sites)
        if name is None and len(self.sites) == 1:
            return next(iter(self.sites.values()))
        if name is None or name not in self.sites:
            raise InputError(f"site {name}", "the prediction has no such", f"Name one of {names}")
        return self.sites[name]

    @property
    def sample_weight(self) -> Float[np.ndarray, " j"]:
        """Weights of the joint draws, those of their components."""
        each = len(next(iter(self.samples.values()))) // len(self.weight)
        return np.repeat(self.weight, each) / each

    def motion(self, values: Mapping[str, Float[np.ndarray, "n d"]]) -> xr.Dataset:
        """Return what is seen as a Motion, and these values for what is not.

        Parameters
        ----------
        values
            Of the observed sites, in the recordings' units.

        Raises
        ------
        InputError
            If what is predicted are no motions.
        """
        if not isinstance(self.data, MotionData):
            raise InputError("prediction", "it is none of motions", "Use `to_dataset`")
        observed, units = self.data.observed(), self.data.units()
        whole = {
            name: np.where(np.isfinite(seen := observed[name].values), seen, units[name].scaled(y))
            for name, y in values.items()
        }
        return self.data.to_motion(whole)

    def to_dataset(self, quantiles: tuple[float, ...] = (0.05, 0.95)) -> xr.Dataset:
        """Return mean, standard deviation and quantiles, labelled as the recordings are.

        Variables are called ``<site>_mean``, ``<site>_sd`` and ``<site>_quantile``, the last
        with a dimension ``quantile`` in front.
        """
        observed = self.data.observed()
        out: dict[str, Any] = {}
        for name, mixture in self.sites.items():
            dims = observed[name].dims
            out[f"{name}_mean"] = (dims, mixture.means())
            out[f"{name}_sd"] = (dims, mixture.sds())
            each = np.stack([mixture.quantile(q) for q in quantiles])
            out[f"{name}_quantile"] = (("quantile", *dims), each)
        coords = {"quantile": list(quantiles), **observed.coords}
        attrs = {"draws": self.draws, "of": self.of, "inference": self.inference}
        return xr.Dataset(out, coords, attrs)

    def __repr__(self) -> str:
        """Return what is predicted, and from how many draws."""
        shapes = ", ".join(
            f"{name} {' x '.join(map(str, m.means().shape))}" for name, m in self.sites.items()
        )
        told = f"{self.draws} of {self.of} draws"
        if self.of == 1:
            told = "a point estimate: intervals leave out how unsure the trained model is"
        return f"Prediction of {shapes}, {len(self.weight)} components, {told}"


@one_at_a_time
def predict(
    fit: Fit,
    recordings: xr.Dataset,
    *,
    draws: int = DRAWS,
    modes: int = MODES,
    max_steps: int = SEARCH_STEPS,
    samples: int = 1,
    seed: int = 0,
) -> Prediction:
    """Predict every entry of recordings, given those that are there.

    Parameters
    ----------
    fit
        A fit of any model, by any method.
    recordings
        As the model is trained on; NaN where missing.
    draws
        At most so many draws of the fit, evenly spread.
    modes
        At most so many modes of the recordings' own unknowns for every draw.
    max_steps
        At most so many steps of the search for them.
    samples
        Joint draws of all entries, of every draw of the fit and mode.
    seed
        Of random parts: initial values, and draws.

    Raises
    ------
    InputError
        If the recordings are not such as the model was trained on.
    NumericalError
        If no initial values of the unknowns have a finite log density.
    """
    require_seed(seed)
    model, training = require_model(fit), fit.training
    new = seen = wide = model.prepare(recordings, training)
    if isinstance(model, InfersFromContext):
        seen = model.prepare(model.padded(model.until_last_seen(recordings)), training)
        wide = model.prepare(model.padded(recordings), training)
    values, _ = stacked(fit, draws)
    keys = draw_keys(seed, values)
    begun = find_modes(model, training.data, seen, values, modes, max_steps, seed)
    unravel, at = (None, None) if begun is None else begun
    about = model.unknown_draws if isinstance(model, IntegratesUnknowns) and begun else 0
    about = -(-about // len(keys))
    counts = Counts(about, -(-MIXTURES // (len(keys) * max(about, 1))), samples)

    def told(draw_and_key: tuple, frames: Any, *data: Any) -> tuple:
        draw, key = draw_and_key
        asked = (model, unravel, counts, trained_model(model, frames, draw), key, *data)
        require_memory("the prediction", predict_one, *asked, mend=SMALLER)
        return predict_one(*asked)

    found = one_by_one(told, (dict(values), keys), training.data[0], seen.data, wide.data, at)
    entries, drawn, unknowns, log_mass = found
    if wide is not new:
        entries, drawn = _without_padding(entries, drawn, new.observed())
    entries = {name: _distinct(each) for name, each in entries.items()}
    log_mass = _without_twins(np.asarray(log_mass), entries, training.observed())
    of_modes = _weights(log_mass)
    best = np.unravel_index(np.argmax(of_modes), of_modes.shape)
    mode = {name: np.asarray(np.asarray(value)[best][0]) for name, value in unknowns.items()}
    weight = np.repeat(of_modes[..., None] / max(about, 1), max(about, 1), axis=2)
    if about:
        # The modes themselves, which stand first, have told which of them are one.
        entries = {n: type(e)(*(part[:, :, 1:] for part in e)) for n, e in entries.items()}
        unknowns = {name: value[:, :, 1:] for name, value in unknowns.items()}
    kept = weight.ravel() > 0.0
    require_finite(float(np.sum(weight)), next(iter(entries)))
    units = new.units()

    def flat(a: np.ndarray) -> np.ndarray:
        return np.asarray(a).reshape(-1, *np.shape(a)[3:])[kept]

    w = weight.ravel()[kept]
    sites = {name: _mixture(each, kept, w).rescaled(*units[name]) for name, each in entries.items()}
    drawn = {n: units[n].natural(np.concatenate(flat(s))) for n, s in drawn.items()}
    posterior = fit.tree["posterior"].sizes
    return Prediction(
        new,
        sites,
        drawn,
        w,
        _evidence(log_mass, 0 if at is None else at.at.shape[1]),
        {name: flat(value) for name, value in unknowns.items()},
        values,
        np.repeat(np.arange(len(keys)), weight[0].size)[kept],
        posterior["chain"] * posterior["draw"],
        str(fit.tree.attrs["inference"]),
        mode,
        int(best[0]),
    )


def require_model(fit: Fit) -> Model:
    """Return the fit's model, if it has all verbs.

    Raises
    ------
    InputError
        If it can be fitted only.
    """
    if not isinstance(fit.model, Model):
        lacking = [n for n in ("condition", "predict", "identified", "pointwise", "points",
                               "sbc_case", "example", "about")
                   if not hasattr(fit.model, n)]  # fmt: skip
        raise InputError(
            f"model {fit.model.name!r}",
            f"it has no {', '.join(lacking)}",
            "Add these methods: the page on adding a model says what each returns",
        )
    return fit.model


def _without_padding(
    entries: Mapping[str, Any], drawn: Mapping[str, np.ndarray], observed: xr.Dataset
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Leave out what is said (..., N, D) of frames that recordings were followed by."""
    rows = {name: len(observed[name]) for name in entries}
    short = {
        name: type(each)(*(np.asarray(part)[..., : rows[name], :] for part in each))
        for name, each in entries.items()
    }
    return short, {name: np.asarray(each)[..., : rows[name], :] for name, each in drawn.items()}


def _without_twins(
    log_mass: Float[np.ndarray, "s k"], entries: Mapping[str, Any], observed: xr.Dataset
) -> Float[np.ndarray, "s k"]:
    """Leave out modes that predict what a mode of more mass does: they were found twice."""
    out = np.where(np.isfinite(log_mass), log_mass, -np.inf)
    sds = {name: float(np.nanstd(observed[name].values)) for name in entries}
    for row, masses in enumerate(out):
        kept: list[int] = []
        for mode in np.argsort(-masses, kind="stable"):
            alike = any(
                all(
                    np.max(np.abs(each[0][row, mode, 0] - each[0][row, other, 0]))
                    <= ALIKE * sds[name]
                    for name, each in entries.items()
                )
                for other in kept
            )
            if alike:
                masses[mode] = -np.inf
            else:
                kept.append(int(mode))
    return out


def _distinct(
    entries: NormalEntries | BernoulliEntries,
) -> NormalEntries | BernoulliEntries:
    """Keep one of several distributions of an entry (S, M, L, J, ...) that are all the same."""
    parts = [np.asarray(part) for part in entries]
    ones = [part[:, :, :, :1] for part in parts]
    if all(
        np.array_equal(p, np.broadcast_to(one, p.shape)) for p, one in zip(parts, ones, strict=True)
    ):
        parts = ones
    return type(entries)(*parts)


def _mixture(
    entries: NormalEntries | BernoulliEntries,
    kept: Bool[np.ndarray, " k"],
    weight: Float[np.ndarray, " w"],
) -> Mixture | BernoulliMixture:
    """Mix marginals (S, M, L, J, N, D), or with more axes before N, alike in weight each."""

    def flat(a: np.ndarray) -> np.ndarray:
        each = a.reshape(int(np.prod(a.shape[:3])), -1, *a.shape[-2:])[kept]
        return each.reshape(-1, *a.shape[-2:])

    parts = [flat(np.asarray(part)) for part in entries]
    count = len(parts[0]) // len(weight)
    return mixture_of(type(entries)(*parts), np.repeat(weight, count) / count)


def _weights(log_mass: Float[np.ndarray, "s k"]) -> Float[np.ndarray, "s k"]:
    """Weights of the modes of every draw; draws count alike."""
    log_mass = np.where(np.isfinite(log_mass), log_mass, -np.inf)
    away = log_mass - log_mass.max(axis=1, keepdims=True)
    mass = np.where(away > -NEGLIGIBLE, np.exp(away), 0.0)
    return mass / mass.sum(axis=1, keepdims=True) / len(mass)


def _evidence(log_mass: Float[np.ndarray, "s k"], unknowns: int) -> Float[np.ndarray, " s"]:
    """Laplace's approximation of the density of what is seen, for every draw."""
    finite = np.where(np.isfinite(log_mass), log_mass, -np.inf)
    return np.asarray(logsumexp(finite, axis=1)) + 0.5 * unknowns * np.log(2.0 * np.pi)
