"""How many people, and how many strides of each, it takes to find a difference."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ..errors import InputError
from ..gp.curve_differences import Difference, People, difference, factor_of
from ..seeds import require_seed
from .contrast import Contrast
from .contrast_design import PAIRED

SIMULATIONS, DRAWS = 200, 1000
PEOPLE = (6, 8, 12, 16, 24)
# A difference is to be found where it is more than this share of its largest.
SOUGHT = 0.5


@dataclass(frozen=True, repr=False)
class Power:
    """Of every number of people, in how many simulations the difference was found.

    people
        Numbers of people, in pairs, or in each of two groups.
    strides
        Of each of them in a condition.
    found
        Share of simulations (one a number of people) in which the simultaneous band lies beyond
        the region of practical equivalence, on the right side, somewhere in the difference.
    error
        Its Monte Carlo standard error.
    width
        Half the width of the band in the middle of simulations, the mean over phases.
    """

    people: tuple[int, ...]
    strides: int
    found: Float[np.ndarray, " n"]
    error: Float[np.ndarray, " n"]
    width: Float[np.ndarray, " n"]

    def __repr__(self) -> str:
        """Return a line for every number of people."""
        lines = [f"Power with {self.strides} strides each"]
        lines += [
            f"  {n} people: {100 * found:.0f} % ± {100 * error:.0f} %, band ± {width:.3g}"
            for n, found, error, width in zip(
                self.people, self.found, self.error, self.width, strict=True
            )
        ]
        return "\n".join(lines)

    def enough(self, power: float = 0.8) -> int | None:
        """Return the smallest number of people with this power; None where none has."""
        which = np.flatnonzero(self.found >= power)
        return self.people[which[0]] if len(which) else None


def power(
    pilot: Contrast, effect: float | Float[np.ndarray, " t"], *,
    people: Sequence[int] = PEOPLE, strides: int = 10, simulations: int = SIMULATIONS,
    seed: int = 0,
) -> Power:  # fmt: skip
    """Return how often a difference would be found, by number of people, as a pilot tells.

    Every simulation draws the variances of people and strides from the pilot's posterior, so that
    what a small pilot does not know makes the power less sure; then people, their strides, and
    the contrast as `bm.contrast` has it, of the same design, probability and region of practical
    equivalence.

    Parameters
    ----------
    pilot
        A contrast without covariates.
    effect
        The true difference, in the curves' unit: one number, or a curve (T,) over the pilot's
        phases.
    people
        Numbers of people to try: in both conditions of a paired pilot, or in each group.
    strides
        Of each of them in a condition. Where the pilot has one stride of each person, nothing tells
        the sd of strides, and it changes nothing.
    simulations, seed
        So many of each number of people.

    Raises
    ------
    InputError
        If a number cannot be used, the effect is zero or has another length, or the pilot has
        covariates.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> pilot = bm.contrast(curves, {"gait": "walk"}, {"gait": "run"})  # doctest: +SKIP
    >>> bm.power(pilot, 5.0, people=[6, 8, 10]).enough(0.8)  # doctest: +SKIP
    """
    random = np.random.default_rng(require_seed(seed))
    curve = _checked(pilot, effect, people, strides, simulations)
    sought = np.abs(curve) > SOUGHT * np.abs(curve).max()
    rows = []
    for count in people:
        runs = [_one(pilot, curve, sought, count, strides, random) for _ in range(simulations)]
        found, width = np.array(runs).T
        rows.append((found.mean(), np.sqrt(found.var() / simulations), np.median(width)))
    found, error, width = np.array(rows).T
    return Power(tuple(people), strides, found, error, width)


def _checked(
    pilot: Contrast, effect: float | Float[np.ndarray, " t"], people: Sequence[int], strides: int,
    simulations: int,
) -> Float[np.ndarray, " t"]:  # fmt: skip
    curve = np.asarray(effect, dtype=float)
    if curve.ndim > 1 or (curve.ndim == 1 and curve.shape != pilot.along.shape):
        raise InputError("effect", f"its shape is {curve.shape}",
                         f"Give a number, or {len(pilot.along)} of them")  # fmt: skip
    if not np.isfinite(curve).all() or not np.abs(curve).max() > pilot.rope:
        raise InputError(
            "effect", "it is nowhere more than is practically none", "Give a larger difference"
        )
    if not people or min(people) < PAIRED or strides < 1 or simulations < 1:
        raise InputError(
            "the people, strides or simulations", "there are too few",
            f"Give {PAIRED} people or more, and one of the others at least",
        )  # fmt: skip
    columns = 1 if pilot.design.paired else 2
    if pilot.design.people.design.shape[1] > columns:
        raise InputError("the pilot", "it has covariates", "Make a contrast without them")
    return np.broadcast_to(curve, pilot.along.shape)


def _one(
    pilot: Contrast, curve: Float[np.ndarray, " t"], sought: Bool[np.ndarray, " t"],
    count: int, strides: int, random: np.random.Generator,
) -> tuple[float, float]:  # fmt: skip
    """Return whether the difference is found in one simulation, and half the width of the band."""
    people = simulated_people(pilot.difference, pilot.design.people, curve, count, strides, random)
    made = difference(people, DRAWS, random)
    away = np.abs(made.draws - made.mean) / made.sd
    half = np.quantile(away.max(axis=1), pilot.probability) * made.sd
    beyond = np.sign(curve) * made.mean - half > pilot.rope
    return float(beyond[sought].any()), float(half.mean())


def simulated_people(
    known: Difference, like: People, curve: Float[np.ndarray, " t"], count: int, strides: int,
    random: np.random.Generator,
) -> People:  # fmt: skip
    """Return people drawn as the model has them, with variances of one draw of a posterior.

    Parameters
    ----------
    known
        The posterior.
    like
        Who it was learned from.
    curve
        The true difference.
    count
        People, of each group where there are two.
    strides
        Of each, in each condition.
    random
        What they are drawn with.
    """
    phases, root = len(curve), factor_of(known.correlation)
    grouped = bool(like.group.any())
    group = np.repeat([0, 1], count) if grouped else np.zeros(count, dtype=int)
    n, draw = len(group), int(random.integers(len(known.draws)))
    sigma, kappa2 = np.sqrt(known.sigma2[draw]), known.kappa2[draw]

    def fields(*shape: int) -> np.ndarray:
        return random.standard_normal((*shape, root.shape[1])) @ root.T

    told = like.freedom.any(axis=1)
    # A condition's strides are of its group's people alone; those of one variance are of all.
    apart = np.eye(2)[group] if grouped and len(told) > 1 else np.ones((n, len(told)))
    both = 2.0 if len(told) == 1 and not grouped else 1.0
    over = (both / strides * apart * told)[..., None] * np.ones(phases)
    noise = np.sqrt(np.einsum("nct,ct->nt", over, kappa2)) * fields(n)
    scale = np.where(group == 1, known.ratio, 1.0)[:, None] * sigma
    lift = np.where(group == 0, 1.0, 0.0)[:, None] * curve
    freedom = (both * (strides - 1) * apart.sum(axis=0) * told)[:, None] * np.ones(phases)
    squares = np.stack([
        np.sum(fields(int(f[0])) ** 2, axis=0) if f[0] else np.zeros(phases) for f in freedom
    ])  # fmt: skip
    design = np.eye(2)[group] if grouped else np.ones((n, 1))
    asked = np.array([1.0, -1.0]) if grouped else np.ones(1)
    return People(
        lift + scale * fields(n) + noise, design, asked, over, kappa2 * squares, freedom, group,
        like.periodic,
    )  # fmt: skip
