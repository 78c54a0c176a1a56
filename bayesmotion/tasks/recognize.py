"""Who moves and what they do: posterior class probabilities of motion segments.

For every probe the density of each combination of levels, one of each mode's levels being
"never seen before", is averaged over the draws of a fit. As it stands it is too sure of
itself: vectors are long, and how new people differ is learned from few. So probabilities are
calibrated on the training segments alone, by leaving out in turn each level (what a new one
looks like), and repetitions or cells (what known ones look like):

    p(new | y)    = sigmoid(slope log odds(y) + offset)           Platt (1999)
    p(l | known)  = (1 - doubt) softmax_l(sharpness log p(y | l)) + doubt / L,  sharpness <= 1

Platt's targets are not 1 and 0 but (n + 1) / (n + 2) and doubt = 1 / (m + 2), where n levels
and m cells or other levels were left out: of three people left out and noticed the next one
is not noticed with certainty. Probabilities end at these: none is nearer to 0 or 1 than the
training can tell.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float
from scipy.optimize import minimize
from scipy.special import expit, logit, logsumexp

from ..catalogue import lacking
from ..errors import InputError
from ..fit import Fit
from ..gp.linalg import AnyArray, require_finite
from ..inference.draws import stacked
from ..motion.joining import split
from ..motion.resampling import at_rate
from ..verbs import RecognizesLevels
from .cautions import cautions, warn

DRAWS = 100
FOLDS = 4
NEW = "(new)"


@runtime_checkable
class LabelledSegments(Protocol):
    """Training data of labelled segments."""

    @property
    def levels(self) -> dict[str, list[str]]:
        """For each mode (a label) the names of the known levels."""
        ...

    @property
    def segments(self) -> xr.DataArray:
        """The segments (clip, ...), with the modes as labels."""
        ...


@dataclass(frozen=True)
class Recognizer:
    """A trained model of labelled segments.

    model
        The model with its settings.
    training
        The training segments as the program saw them.
    values
        Values of the sites (S, ...), draw by draw.
    """

    model: RecognizesLevels
    training: LabelledSegments
    values: Mapping[str, AnyArray]

    @property
    def levels(self) -> dict[str, list[str]]:
        """For each mode the names of the known levels."""
        return self.training.levels

    def log_density(self, probes: xr.DataArray) -> Float[np.ndarray, "n ..."]:
        """Return the log density of probes for each level of each mode, the last one new.

        It is that of the mean over the draws of the density.
        """
        each = self.model.level_log_densities(self.training, probes, self.values)
        require_finite(each, "y")
        flat = np.asarray(logsumexp(np.sort(each, axis=0), axis=0)) - np.log(len(each))
        return flat.reshape(len(flat), *(len(known) + 1 for known in self.levels.values()))

    def without(self, held: Bool[np.ndarray, " n"]) -> "Recognizer":
        """Return the recognizer of other training segments, with the same site values."""
        return Recognizer(self.model, self.model.without(self.training, held), self.values)

    @cached_property
    def calibration(self) -> "dict[str, Calibration]":
        """How odds become probabilities, mode by mode; see the module."""
        return calibrate(self)


@dataclass(frozen=True)
class Calibration:
    """How log densities become probabilities in one mode.

    slope, offset
        Of the log odds of a new level, for as many new levels as known ones.
    sharpness
        Power of the densities of known levels.
    doubt, most
        Least and largest probability of a new level, for as many new levels as known ones.
    """

    slope: float
    offset: float
    sharpness: float
    doubt: float
    most: float

    def new(self, log_odds: Float[np.ndarray, " n"], p_new: float = 0.5) -> Float[np.ndarray, " n"]:
        """Return the probability of a new level, by its log odds and that beforehand."""
        p = np.clip(expit(self.slope * log_odds + self.offset), self.doubt, self.most)
        return expit(logit(p) + logit(p_new))

    def known(self, log_p: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """Return the probabilities of known levels, if it is one, by their log densities."""
        sharp = _softmax(self.sharpness * log_p)
        return (1.0 - self.doubt) * sharp + self.doubt / log_p.shape[1]


def recognizer_of(fit: Fit, draws: int = DRAWS) -> Recognizer:
    """Return the recognizer of a fit, of at most so many draws, evenly spread.

    Raises
    ------
    InputError
        If the fit is of another model.
    """
    model = fit.model
    if not isinstance(model, RecognizesLevels):
        raise lacking(model.name, "it does not tell who moves and what they do", RecognizesLevels)
    training = fit.training
    assert isinstance(training, LabelledSegments), "levels are those of labelled segments"
    return Recognizer(model, training, stacked(fit, draws)[0])


def recognize(
    fit: Fit, recordings: xr.Dataset, draws: int = DRAWS, *, p_new: float = 0.5
) -> xr.Dataset:
    """Return calibrated probabilities of who moves in recordings and of what they do.

    Parameters
    ----------
    fit
        Of the motion tensor.
    recordings
        Clips, each one segment; labels are not looked at. Missing values are NaN.
    draws
        At most so many draws of the fit, evenly spread.
    p_new
        Probability beforehand that a level is new.

    Returns
    -------
    For each mode a variable ``p_<mode>`` (clip, mode) of probabilities, the last level called
    ``(new)``.

    Raises
    ------
    InputError
        If the fit is of another model, or skeletons have other joints.

    Warns
    -----
    MotionWarning
        If clips have another frame rate or one trained the fit, or the fit's draws are not to be
        trusted.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> from bayesmotion.tasks.recognize import recognize
    >>> model, clips = bm.example("motion_tensor")
    >>> found = recognize(bm.fit(model, clips), clips)  # doctest: +SKIP
    """
    recognizer = recognizer_of(fit, draws)
    recordings, resampled = at_rate(recordings, fit.frame_rate)
    probes = recognizer.model.segments(recordings, recognizer.training)
    told = [text for clip in split(recordings).values() for text in cautions(fit, clip)]
    warn("the recognition", list(dict.fromkeys([*resampled, *told])))
    return calibrated(recognizer, probes, p_new)


def calibrated(recognizer: Recognizer, probes: xr.DataArray, p_new: float = 0.5) -> xr.Dataset:
    """Return what `recognize` does, of segments as vectors."""
    if not 0.0 < p_new < 1.0:
        raise InputError(f"p_new {p_new}", "it is no probability", "Give one between 0 and 1")
    density = recognizer.log_density(probes)
    found: dict[str, tuple] = {}
    names = {mode: [*known, NEW] for mode, known in recognizer.levels.items()}
    for axis, mode in enumerate(names):
        one = recognizer.calibration[mode]
        log_p = _of_mode(density, axis)
        new, known = one.new(_log_odds(log_p), p_new), one.known(log_p[:, :-1])
        p = np.concatenate([(1.0 - new)[:, None] * known, new[:, None]], axis=1)
        found[f"p_{mode}"] = (("clip", mode), p)
    return xr.Dataset(found, coords={"clip": probes["clip"].values, **names})


def class_probabilities(
    recognizer: Recognizer, probes: xr.DataArray, *, novelty: bool = True
) -> xr.Dataset:
    """Return the model's own probabilities, not calibrated; all levels as probable beforehand.

    Parameters
    ----------
    recognizer
        A trained motion tensor.
    probes
        Segments described as the training segments were.
    novelty
        Whether levels never seen are among the candidates.

    Returns
    -------
    For each mode ``p_<mode>`` (clip, mode), and with `novelty` ``log_odds_<mode>`` (clip) for
    the last level, which is new.
    """
    density = recognizer.log_density(probes)
    names = {mode: list(known) for mode, known in recognizer.levels.items()}
    if novelty:
        names = {mode: [*known, NEW] for mode, known in names.items()}
    else:
        density = density[(slice(None), *(slice(-1) for _ in names))]
    found: dict[str, tuple] = {}
    for axis, mode in enumerate(names):
        log_p = _of_mode(density, axis)
        found[f"p_{mode}"] = (("clip", mode), _softmax(log_p))
        if novelty:
            found[f"log_odds_{mode}"] = (("clip",), _log_odds(log_p))
    return xr.Dataset(found, coords={"clip": probes["clip"].values, **names})


def best_levels(probabilities: xr.Dataset, mode: str) -> list[str]:
    """Return the most probable known level of a mode for every probe."""
    p = probabilities[f"p_{mode}"]
    known = p.sel({mode: [name for name in p[mode].values.tolist() if name != NEW]})
    return known[mode].values[known.values.argmax(axis=1)].tolist()


@dataclass(frozen=True)
class _LeftOut:
    """Segments that were left out together: log densities of the levels of the modes.

    density
        (N, L + 1, ...) by levels of what was not left out, `names` mode by mode.
    labels
        True levels, mode by mode.
    """

    density: Float[np.ndarray, "n ..."]
    names: Mapping[str, Sequence[str]]
    labels: Mapping[str, Sequence[str]]


def calibrate(recognizer: Recognizer) -> dict[str, Calibration]:
    """Calibrate every mode by leaving out training segments; see the module.

    Raises
    ------
    InputError
        If there is nothing that can be left out: two levels with two segments are needed.
    """
    segments, modes = recognizer.training.segments, list(recognizer.levels)
    levels = {
        mode: [_left_out(recognizer, segments[mode].values == name) for name in known]
        for mode, known in recognizer.levels.items()
    }
    folds = repetition_folds(segments, modes, FOLDS) or _cells(segments, modes)
    repeated = [_left_out(recognizer, held) for held in folds]
    out = {}
    for axis, mode in enumerate(modes):
        others = [part for other in modes if other != mode for part in levels[other]]
        parts = [*levels[mode], *repeated, *others]
        units, odds, is_new, right = [], [], [], []
        for index, part in enumerate(parts):
            log_p, labels = _of_mode(part.density, axis), part.labels[mode]
            names = list(part.names[mode])
            odds.append(_log_odds(log_p))
            is_new += [label not in names for label in labels]
            # What counts as one: a level that was left out, or a cell of known ones.
            cells = zip(*(part.labels[m] for m in modes), strict=True)
            known = index >= len(levels[mode])
            units += [(index < len(levels[mode]) + len(repeated), cell) if known else
                      (index,) for cell in cells]  # fmt: skip
            right += [(log_p[n, :-1], names.index(label)) for n, label in enumerate(labels)
                      if label in names]  # fmt: skip
        out[mode] = _fitted(np.concatenate(odds), np.array(is_new), units, right)
    return out


def _fitted(
    odds: Float[np.ndarray, " n"],
    is_new: Bool[np.ndarray, " n"],
    units: Sequence[tuple],
    right: Sequence[tuple[np.ndarray, int]],
) -> Calibration:
    """Fit slope and offset by Platt's rule, and the sharpness by the same targets."""
    if is_new.all() or not is_new.any():
        raise InputError(
            "recognition",
            "nothing can be left out of the training segments to calibrate by",
            "Give two levels or more of every mode, and two segments or more of each",
        )
    weight = np.zeros(len(odds))
    counts = []
    for new in (True, False):
        of = is_new == new
        names = [unit for unit, here in zip(units, of, strict=True) if here]
        share = {unit: 1.0 / names.count(unit) for unit in set(names)}
        weight[of] = np.array([share[unit] for unit in names]) / len(share)
        counts.append(len(share))
    most, doubt = (counts[0] + 1.0) / (counts[0] + 2.0), 1.0 / (counts[1] + 2.0)
    target = np.where(is_new, most, doubt)
    # In units of their own spread odds are of a size that the search can begin with.
    scale = max(float(odds.std()), 1e-9)

    def loss(at: np.ndarray) -> float:
        log = np.exp(at[0]) * odds / scale + at[1]
        return float(weight @ (np.logaddexp(0.0, log) - target * log))

    found = minimize(loss, np.zeros(2), method="Nelder-Mead", options={"maxiter": 2000})
    slope = float(np.exp(found.x[0])) / scale
    grid = np.exp(np.linspace(np.log(1e-4), 0.0, 200))
    scores = [_sharp_score(right, s, doubt) for s in grid]
    sharpness = float(grid[int(np.argmax(scores))])
    return Calibration(slope, float(found.x[1]), sharpness, doubt, most)


def _sharp_score(right: Sequence[tuple[np.ndarray, int]], sharpness: float, doubt: float) -> float:
    """Return the mean log score of known levels, against targets that leave some doubt."""
    total = 0.0
    for log_p, true in right:
        log = sharpness * log_p - np.asarray(logsumexp(sharpness * log_p))
        total += (1.0 - doubt) * log[true] + doubt * log.mean()
    return total / len(right)


def _left_out(recognizer: Recognizer, held: Bool[np.ndarray, " n"]) -> _LeftOut:
    part = recognizer.without(held)
    probes = recognizer.training.segments[held]
    labels = {mode: probes[mode].values.tolist() for mode in part.levels}
    return _LeftOut(part.log_density(probes), part.levels, labels)


def repetition_folds(
    segments: xr.DataArray, modes: Sequence[str], most: int | None = None
) -> list[Bool[np.ndarray, " n"]]:
    """Return masks that leave out the first, second, ... repetition of every cell in turn.

    A cell's only repetition is never left out. With `most` (at least 2) there are so many
    masks at most: later repetitions of a cell go with earlier ones.
    """
    cells = list(zip(*(segments[mode].values.tolist() for mode in modes), strict=True))
    seen: dict[tuple, int] = {}
    order = np.zeros(len(cells), dtype=int)
    for row, cell in enumerate(cells):
        order[row] = seen[cell] = seen.get(cell, -1) + 1
    several = np.array([seen[cell] > 0 for cell in cells])
    order = order if most is None else order % most
    return (
        [several & (order == k) for k in range(order[several].max() + 1)] if several.any() else []
    )


def _cells(segments: xr.DataArray, modes: Sequence[str]) -> list[Bool[np.ndarray, " n"]]:
    """Return masks that leave out every cell whose levels are all recorded elsewhere too."""
    labels = np.stack([segments[mode].values for mode in modes], axis=1)
    masks = [(labels == cell).all(axis=1) for cell in np.unique(labels, axis=0)]
    return [
        held for held in masks
        if all(np.isin(labels[held][0, m], labels[~held, m]) for m in range(len(modes)))
    ]  # fmt: skip


def _of_mode(density: Float[np.ndarray, "n ..."], axis: int) -> Float[np.ndarray, "n k"]:
    """Return log densities of the levels of one mode, summed over those of the others."""
    others = tuple(i for i in range(1, density.ndim) if i != axis + 1)
    return np.asarray(logsumexp(density, axis=others))


def _log_odds(log_p: Float[np.ndarray, "n k"]) -> Float[np.ndarray, " n"]:
    return log_p[:, -1] - np.asarray(logsumexp(log_p[:, :-1], axis=1))


def _softmax(log_p: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    return np.exp(log_p - np.asarray(logsumexp(log_p, axis=1, keepdims=True)))
