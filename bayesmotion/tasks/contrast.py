"""The difference of two conditions over phase or time, with bands that hold for people."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from ..errors import InputError
from ..gp.curve_differences import Difference, difference
from ..motion.io.curves import axis_of
from ..seeds import require_seed
from .cautions import warn
from .contrast_design import Design, Where, design_of, told

PROBABILITY, DRAWS = 0.95, 4000


@dataclass(frozen=True)
class Region:
    """Neighbouring phases of which the same is said.

    start, end
        The first phase (or time) and the last; where they pass the end of a cycle, start > end.
    sign
        1 or -1: which way the curves differ; 0 where they are practically the same.
    probability
        That it is so at all of these phases together.
    """

    start: float
    end: float
    sign: int
    probability: float


@dataclass(frozen=True, repr=False)
class Contrast:
    """What is known of the first condition's mean curve less that of the second.

    first, second
        The conditions.
    design
        Who was compared: people, their strides, and whether in pairs.
    difference
        The posterior: moments, draws, and the sds of people and strides.
    rope
        Smaller differences are practically none, in the curves' unit.
    probability
        Of bands and regions, where nothing else is asked for.
    periodic
        Whether the last phase is followed by the first.
    messages
        What is not to be believed of it, in sentences.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> curves = bm.read_curves("knee.csv")  # doctest: +SKIP
    >>> found = bm.contrast(curves, {"condition": "fast"}, {"condition": "slow"})  # doctest: +SKIP
    >>> found.regions(), found.band(0.9)  # doctest: +SKIP
    """

    first: Where
    second: Where
    design: Design
    difference: Difference
    rope: float
    probability: float
    periodic: bool
    messages: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return who was compared, and where the conditions differ."""
        design = self.design
        least, most = design.strides.min(), design.strides.max()
        if design.paired:
            who = f"{len(design.names)} people in both"
        else:
            sizes = np.bincount(design.people.group)
            who = f"{sizes[0]} and {sizes[1]} people"
            least = design.strides.max(axis=1).min()
        strides = f"{least} strides each" if least == most else f"{least} to {most} strides each"
        lines = [f"Contrast of {told(self.first)} less {told(self.second)}: {who}, {strides}"]
        lines += [f"  {self.said(region)}" for region in self.regions()]
        if not self.regions():
            lines.append(
                f"  no {design.axis} where the {self._share()} band excludes no difference"
            )
        return "\n".join([*lines, *(f"  warning: {text}" for text in self.messages)])

    @property
    def mean(self) -> Float[np.ndarray, " t"]:
        """Posterior mean of the difference, in the curves' unit."""
        return self.difference.mean

    @property
    def sd(self) -> Float[np.ndarray, " t"]:
        """Posterior standard deviation of the difference."""
        return self.difference.sd

    @property
    def along(self) -> Float[np.ndarray, " t"]:
        """Phases or times."""
        return self.design.along

    def interval(
        self, probability: float | None = None
    ) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
        """Return the ends of the central interval of every phase by itself."""
        tail = 0.5 * (1.0 - self._checked(probability))
        low, high = np.quantile(self.difference.draws, [tail, 1.0 - tail], axis=0)
        return low, high

    def band(
        self, probability: float | None = None
    ) -> tuple[Float[np.ndarray, " t"], Float[np.ndarray, " t"]]:
        """Return the ends of the simultaneous band, which holds at all phases together.

        As many sds wide at all phases: those within which so many of the draws stay throughout.
        """
        away = np.abs(self.difference.draws - self.mean) / self.sd
        half = np.quantile(away.max(axis=1), self._checked(probability)) * self.sd
        return self.mean - half, self.mean + half

    @property
    def positive(self) -> Float[np.ndarray, " t"]:
        """Probability at each phase that the first condition's curve is above the second's."""
        return (self.difference.draws > 0.0).mean(axis=0)

    @property
    def beyond(self) -> Float[np.ndarray, " t"]:
        """Probability at each phase of a difference beyond the region of practical equivalence."""
        return (np.abs(self.difference.draws) > self.rope).mean(axis=0)

    def regions(self, probability: float | None = None) -> tuple[Region, ...]:
        """Return where the simultaneous band lies beyond the region of practical equivalence.

        Without such a region, where it excludes zero.
        """
        low, high = self.band(probability)
        draws, found = self.difference.draws, []
        for sign, which in ((1, low > self.rope), (-1, high < -self.rope)):
            found += self._runs(which, sign, sign * draws > self.rope)
        return tuple(sorted(found, key=lambda region: region.start))

    def equivalent(self, probability: float | None = None) -> tuple[Region, ...]:
        """Return where the simultaneous band lies within the region of practical equivalence."""
        low, high = self.band(probability)
        inside = (low > -self.rope) & (high < self.rope)
        draws = np.abs(self.difference.draws) < self.rope
        return tuple(sorted(self._runs(inside, 0, draws), key=lambda region: region.start))

    def to_dataset(self) -> xr.Dataset:
        """Return all of it by phase or time, at the contrast's probability.

        Returns
        -------
        ``mean``, ``sd``, ``low`` and ``high`` (pointwise), ``band_low`` and ``band_high``
        (simultaneous), ``positive`` and ``beyond``, ``people_sd``.
        """
        (low, high), (band_low, band_high) = self.interval(), self.band()
        columns = {
            "mean": self.mean, "sd": self.sd, "low": low, "high": high, "band_low": band_low,
            "band_high": band_high, "positive": self.positive, "beyond": self.beyond,
            "people_sd": self.difference.people_sd,
        }  # fmt: skip
        axis = self.design.axis
        return xr.Dataset(
            {name: (axis, column) for name, column in columns.items()},
            coords={axis: self.along},
            attrs={"first": told(self.first), "second": told(self.second),
                   "probability": self.probability, "rope": self.rope},
        )  # fmt: skip

    def plot(self, figure: Figure | None = None) -> Figure:
        """Draw the difference with its bands, and its regions."""
        from ..plots.contrast import contrast_plot

        return contrast_plot(self, figure)

    def said(self, region: Region) -> str:
        """Return a region as a sentence."""
        way = {1: "more", -1: "less", 0: "the same"}[region.sign]
        return (
            f"{way} from {self.design.axis} {region.start:.4g} to {region.end:.4g} "
            f"(probability {region.probability:.3f} throughout)"
        )

    def _share(self) -> str:
        return f"{100 * self.probability:.3g} %"

    def _checked(self, probability: float | None) -> float:
        value = self.probability if probability is None else probability
        if not 0.0 < value < 1.0:
            raise InputError("probability", f"it is {value}", "Give one between 0 and 1")
        return value

    def _runs(
        self, which: Bool[np.ndarray, " t"], sign: int, holds: Bool[np.ndarray, "s t"]
    ) -> list[Region]:
        edges = np.flatnonzero(np.diff(np.concatenate([[False], which, [False]]).astype(int)))
        runs = [np.arange(a, b) for a, b in edges.reshape(-1, 2)]
        if self.periodic and len(runs) > 1 and which[0] and which[-1]:
            runs = [*runs[1:-1], np.concatenate([runs[-1], runs[0]])]
        return [
            Region(
                float(self.along[run[0]]), float(self.along[run[-1]]), sign,
                float(holds[:, run].all(axis=1).mean()),
            )
            for run in runs
        ]  # fmt: skip


def contrast(
    curves: xr.DataArray, first: Where, second: Where, *, over: str = "subject",
    covariates: Sequence[str] = (), rope: float = 0.0, probability: float = PROBABILITY,
    periodic: bool = False, draws: int = DRAWS, seed: int = 0,
) -> Contrast:  # fmt: skip
    """Return what is known of the difference of two conditions' mean curves, first less second.

    Strides are of people, and people differ: what holds of them is learned from as many as there
    are, never from as many strides (`gp.curve_differences` has the model). People seen in both
    conditions are compared with themselves; where there are none, two groups are compared. Who has
    few strides counts less, as far as strides differ.

    Parameters
    ----------
    curves
        Of strides (stride, phase or time), with labels; see `read_curves`. Strides may be missing,
        and phases of them (NaN).
    first, second
        Which strides: ``{"condition": "fast"}``; of several labels all hold.
    over
        The label of what conditions are compared over.
    covariates
        Labels of numbers, such as speed: the difference is that at the same value of each.
    rope
        Half the width of the region of practical equivalence, in the curves' unit.
    probability
        Of bands and regions.
    periodic
        Whether the last phase is followed by the first.
    draws, seed
        So many draws of the posterior.

    Raises
    ------
    InputError
        If a label is missing, conditions have strides in common, or there are too few people:
        three in both conditions, or four in two groups, and one more for each covariate.

    Warns
    -----
    MotionWarning
        Of people who are left out, and of few people.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> curves = bm.read_curves("knee.csv")  # doctest: +SKIP
    >>> found = bm.contrast(curves, {"condition": "fast"}, {"condition": "slow"}, rope=2.0)
    ... # doctest: +SKIP
    >>> found.regions()[0].start  # doctest: +SKIP
    """
    random = np.random.default_rng(require_seed(seed))
    _check(rope, probability, draws)
    if periodic and axis_of(curves) == "time":
        raise InputError("periodic", "the curves go along time", "Give curves over phase")
    design = design_of(curves, first, second, over, covariates, periodic)
    made = difference(design.people, draws, random)
    warn("the contrast", design.messages)
    return Contrast(
        dict(first), dict(second), design, made, rope, probability, periodic, design.messages
    )


def _check(rope: float, probability: float, draws: int) -> None:
    if not (np.isfinite(rope) and rope >= 0.0):
        raise InputError("rope", f"it is {rope}", "Give half a width in the curves' unit, or 0")
    if not 0.0 < probability < 1.0:
        raise InputError("probability", f"it is {probability}", "Give one between 0 and 1")
    if draws < 1:
        raise InputError("draws", f"there are {draws}", "Give some thousands")
