"""One person against the norm: where a curve leaves what is to be expected of new people."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float
from scipy.special import ndtri

from ..errors import InputError
from ..gp.curve_differences import People, difference, factor_of
from ..motion.io.curves import STRIDE, axis_of
from ..seeds import require_seed
from .cautions import warn
from .contrast import DRAWS, PROBABILITY
from .contrast_design import FEW, PAIRED, of_strides, stride_means, which

# From the lower to the upper sixth of a normal distribution, in sds.
NORMAL_WIDTH = 2.0 * float(ndtri(5.0 / 6.0))

Curves = xr.DataArray | Mapping[str, xr.DataArray]


@dataclass(frozen=True)
class AgainstNorm:
    """One channel of a person against the norm.

    along
        Phases or times (T,).
    value
        The person's mean curve (T,).
    mean, sd
        Of the curves of new people, with as many strides (T,).
    low, high
        The simultaneous band that a new person's whole curve stays in, with the probability asked
        for.
    p
        Probability that the curve of a new person of the norm goes as far away somewhere, in sds:
        small for who leaves the norm.
    """

    along: Float[np.ndarray, " t"]
    value: Float[np.ndarray, " t"]
    mean: Float[np.ndarray, " t"]
    sd: Float[np.ndarray, " t"]
    low: Float[np.ndarray, " t"]
    high: Float[np.ndarray, " t"]
    p: float

    @property
    def away(self) -> Float[np.ndarray, " t"]:
        """How far the person is away from the norm's mean, in sds of new people."""
        return (self.value - self.mean) / self.sd

    @property
    def outside(self) -> Bool[np.ndarray, " t"]:
        """Where the person leaves the simultaneous band."""
        return (self.value < self.low) | (self.value > self.high)


@dataclass(frozen=True, repr=False)
class Norm:
    """A person against the norm, by channel.

    person, people
        Who, and how many people the norm is of.
    channels
        By name.
    messages
        What is not to be believed of it, in sentences.
    """

    person: str
    people: int
    channels: Mapping[str, AgainstNorm]
    messages: tuple[str, ...] = ()

    @property
    def p(self) -> float:
        """The smallest p value, times the number of channels: that of any of them being so far off.

        Bonferroni's, which holds however channels go together.
        """
        return min(1.0, len(self.channels) * min(one.p for one in self.channels.values()))

    @property
    def score(self) -> float:
        """Root mean square over channels and phases of how far the person is away, in sds."""
        squares = [np.nanmean(one.away**2) for one in self.channels.values()]
        return float(np.sqrt(np.mean(squares)))

    def __repr__(self) -> str:
        """Return who, and where the norm is left."""
        lines = [
            f"{self.person} against {self.people} people: p = {self.p:.3g}, "
            f"{self.score:.2f} sds away"
        ]
        for name, one in self.channels.items():
            at = one.along[one.outside]
            where = f", outside from {at[0]:.4g} to {at[-1]:.4g}" if len(at) else ""
            lines.append(f"  {name}: p = {one.p:.3g}{where}")
        return "\n".join([*lines, *(f"  warning: {text}" for text in self.messages)])


def norm(
    curves: Curves, person: str, *, where: Mapping[str, object] | None = None,
    over: str = "subject", probability: float = PROBABILITY, periodic: bool = False,
    draws: int = DRAWS, seed: int = 0,
) -> Norm:  # fmt: skip
    """Return where one person's mean curve leaves the predictive distribution of new people.

    The norm is learned of all others (`gp.curve_differences`): its mean, how people differ and how
    their strides do, with what few people leave open about each. A p value is that of the largest
    distance from the mean anywhere, in sds: of people of the norm it is uniform.

    Parameters
    ----------
    curves
        Of strides with labels (`read_curves`), the person's among them; or channels by name.
    person
        Whose: a level of the label `over`. All other people are the norm.
    where
        Which strides are compared, of the person and the norm: ``{"condition": "walk"}``; all if
        None.
    over
        The label of people.
    probability
        Of the band.
    periodic
        Whether the last phase is followed by the first.
    draws, seed
        So many curves of new people.

    Raises
    ------
    InputError
        If the person has no strides, a label is missing, or the norm has fewer than three people.

    Warns
    -----
    MotionWarning
        Of a norm of few people.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> found = bm.norm(bm.read_curves("knee.csv"), "p07")  # doctest: +SKIP
    >>> found.p, found.channels["value"].outside  # doctest: +SKIP
    """
    random = np.random.default_rng(require_seed(seed))
    if not 0.0 < probability < 1.0:
        raise InputError("probability", f"it is {probability}", "Give one between 0 and 1")
    named = {str(curves.name): curves} if isinstance(curves, xr.DataArray) else dict(curves)
    if not named:
        raise InputError("the norm", "there are no channels", "Give curves by name")
    found, smallest = {}, 0
    for name, one in named.items():
        mean, people = _norm_of(one, person, where or {}, over, periodic)
        found[name] = _against(axis_of(one), one, mean, people, probability, draws, random)
        smallest = min(smallest or len(people.value), len(people.value))
    messages = ()
    if smallest < FEW:
        messages = (f"the norm is of {smallest} people: how much people differ is hardly known",)
    warn("the norm", messages)
    return Norm(person, smallest, found, messages)


@dataclass(frozen=True)
class _Mean:
    """A person's mean curve, and one over its strides (T,)."""

    value: Float[np.ndarray, " t"]
    one_over: Float[np.ndarray, " t"]


def _norm_of(
    curves: xr.DataArray, person: str, where: Mapping[str, object], over: str, periodic: bool
) -> tuple[_Mean, People]:
    curves = curves.transpose(STRIDE, axis_of(curves))
    if where:
        curves = curves.isel(stride=which(curves, where))
    here = which(curves, {over: person})
    if here.all():
        raise InputError("the norm", f"all strides are of {person}", "Give those of others too")
    value, count, _ = stride_means(curves.values[here])
    names = curves[over].values.astype(str)
    rest = sorted(set(names[~here]))
    mean, number, squares = (
        np.array(part)
        for part in zip(*(stride_means(curves.values[names == name]) for name in rest), strict=True)
    )
    if np.isfinite(mean).sum(axis=0).min() < PAIRED:
        raise InputError(
            "the norm", f"it has {len(rest)} people, not all at all phases",
            f"Give strides of {PAIRED} others or more at all of them",
        )  # fmt: skip
    strides, within, freedom = of_strides(squares[None], number[None])
    ones = np.ones((len(rest), 1))
    people = People(
        mean, ones, np.ones(1), strides, within, freedom, np.zeros(len(rest), dtype=int), periodic
    )
    return _Mean(value, np.where(count > 0, 1.0 / np.maximum(count, 1), np.nan)), people


def _against(
    axis: str, curves: xr.DataArray, mean: _Mean, people: People, probability: float, draws: int,
    random: np.random.Generator,
) -> AgainstNorm:  # fmt: skip
    known = difference(people, draws, random)
    root = factor_of(known.correlation)
    white = random.standard_normal((draws, root.shape[1])) @ root.T
    one_over = np.where(np.isfinite(mean.one_over), mean.one_over, 0.0)
    new = known.draws + white * np.sqrt(known.sigma2 + known.kappa2[:, 0] * one_over)
    centre = known.mean
    # Moments of few people's t distributions may be infinite; two thirds of the draws are not.
    low, high = np.quantile(new, [1.0 / 6.0, 5.0 / 6.0], axis=0)
    sd = (high - low) / NORMAL_WIDTH
    seen = np.isfinite(mean.value)
    far = (np.abs(new - centre) / sd)[:, seen].max(axis=1)
    own = float((np.abs(mean.value - centre) / sd)[seen].max())
    half = np.quantile(far, probability) * sd
    p = (1.0 + float(np.sum(far >= own))) / (1.0 + draws)
    along = curves[axis].values.astype(float)
    return AgainstNorm(along, mean.value, centre, sd, centre - half, centre + half, p)
