"""Who is compared with whom: people of strides, paired where they were seen in both conditions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from ..errors import InputError
from ..gp.curve_differences import People
from ..motion.io.curves import STRIDE, axis_of

# People a comparison needs: both conditions of so many, or so many in each.
PAIRED, UNPAIRED = 3, 2
# With fewer people than this the result says so.
FEW = 5
# The variance of strides is told apart by condition where each has so many degrees of freedom.
APART = 5

Where = Mapping[str, object]


@dataclass(frozen=True)
class Design:
    """A comparison.

    people
        What is known of every person; see `gp.curve_differences`.
    names
        Of the people, in the order of its rows.
    strides
        So many of each of them in the first condition and in the second (n, 2).
    paired
        Whether everybody was seen in both.
    axis, along
        ``phase`` or ``time``, and its values (T,).
    messages
        What is to be known of it, in sentences.
    """

    people: People
    names: tuple[str, ...]
    strides: np.ndarray
    paired: bool
    axis: str
    along: Float[np.ndarray, " t"]
    messages: tuple[str, ...]


def design_of(
    curves: xr.DataArray, first: Where, second: Where, over: str, covariates: Sequence[str],
    periodic: bool,
) -> Design:  # fmt: skip
    """Return the comparison of two conditions.

    Raises
    ------
    InputError
        If a label is missing, a condition has no strides, both have some of the same, or there
        are too few people.
    """
    axis = axis_of(curves)
    curves = curves.transpose(STRIDE, axis)
    of = [which(curves, first), which(curves, second)]
    if (of[0] & of[1]).any():
        raise InputError(
            "the conditions", f"{told(first)} and {told(second)} have strides in common",
            "Give two that shut each other out",
        )  # fmt: skip
    _label(curves, over)
    for name in covariates:
        _check_covariate(name, _label(curves, name)[of[0] | of[1]])
    person = curves[over].values.astype(str)
    sets = [set(person[one]) for one in of]
    both = sets[0] & sets[1]
    messages = []
    if both and (lone := (sets[0] | sets[1]) - both):
        messages.append(
            f"{', '.join(sorted(lone))} were seen in one of the conditions alone: they are left out"
        )
    cells = _Cells(curves, person, of, covariates)
    if both:
        names = sorted(both)
        people = _paired(cells, names, periodic)
    else:
        names = sorted(sets[0]) + sorted(sets[1])
        people = _unpaired(cells, [sorted(one) for one in sets], periodic)
    _check_enough(people, axis, bool(both))
    strides = np.array([[int((one & (person == name)).sum()) for one in of] for name in names])
    smallest = len(names) if both else min(map(len, sets))
    if smallest < FEW:
        messages.append(
            f"{smallest} people{'' if both else ' in a condition'}: how much people differ is "
            "hardly known, and the intervals are wide for it"
        )
    along = curves[axis].values.astype(float)
    return Design(people, tuple(names), strides, bool(both), axis, along, tuple(messages))


def _check_covariate(name: str, values: np.ndarray) -> None:
    """Refuse covariates that are not numbers, or are missing."""
    if values.dtype.kind not in "fiub" or not np.isfinite(values.astype(float)).all():
        raise InputError(
            f"covariate {name!r}", "not all strides have a number", "Leave strides without it out"
        )


def told(where: Where) -> str:
    """Return a condition as it is written: ``condition=slow``."""
    return ", ".join(f"{name}={level}" for name, level in where.items())


def _label(curves: xr.DataArray, name: str) -> np.ndarray:
    if name not in curves.coords or curves[name].dims != (STRIDE,):
        known = [str(k) for k, coord in curves.coords.items() if coord.dims == (STRIDE,)]
        raise InputError(
            f"label {name!r}", "the strides have none", f"They have {', '.join(known)}"
        )
    return curves[name].values


def which(curves: xr.DataArray, where: Where) -> Bool[np.ndarray, " k"]:
    """Return which strides have all of some labels.

    Raises
    ------
    InputError
        If a label is missing, or no stride has them.
    """
    if not where:
        raise InputError("a condition", "it is empty", "Give a label and its level")
    found = np.ones(curves.sizes[STRIDE], dtype=bool)
    for name, level in where.items():
        values = _label(curves, name)
        found &= (
            values == level
            if values.dtype.kind in "fiub" and not isinstance(level, str)
            else values.astype(str) == str(level)
        )
        if not found.any():
            levels = ", ".join(sorted(set(values.astype(str))))
            raise InputError(told(where), "no stride is of it", f"{name} has the levels {levels}")
    return found


def stride_means(
    values: Float[np.ndarray, "k t"],
) -> tuple[Float[np.ndarray, " t"], np.ndarray, Float[np.ndarray, " t"]]:
    """Return mean, number and sum of squares about the mean of strides; NaN without any."""
    seen = np.isfinite(values)
    count = seen.sum(axis=0)
    total = np.where(seen, values, 0.0).sum(axis=0)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    squares = np.where(seen, values - np.where(count > 0, mean, 0.0), 0.0) ** 2
    return mean, count, squares.sum(axis=0)


@dataclass(frozen=True)
class _Cells:
    """Strides by person and condition."""

    curves: xr.DataArray
    person: np.ndarray
    of: Sequence[Bool[np.ndarray, " k"]]
    covariates: Sequence[str]

    def mean(self, name: str, condition: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return mean (T,), number (T,) and sum of squares about the mean (T,) of strides."""
        return stride_means(self.curves.values[self.of[condition] & (self.person == name)])

    def covariate(self, name: str, condition: int) -> Float[np.ndarray, " p"]:
        """Return the means of covariates over the strides of a person."""
        found = self.of[condition] & (self.person == name)
        return np.array([
            float(np.mean(self.curves[label].values[found].astype(float)))
            for label in self.covariates
        ]) if self.covariates else np.zeros(0)  # fmt: skip


def _paired(cells: _Cells, names: Sequence[str], periodic: bool) -> People:
    sides = [[cells.mean(name, condition) for name in names] for condition in (0, 1)]
    mean, count, squares = (
        np.array([[cell[part] for cell in side] for side in sides]) for part in range(3)
    )
    # A difference between the conditions in a covariate is not that of the conditions.
    moved = [cells.covariate(name, 0) - cells.covariate(name, 1) for name in names]
    design = np.column_stack([np.ones(len(names)), np.array(moved)])
    strides, within, freedom = of_strides(squares, count)
    asked = np.eye(design.shape[1])[0]
    group = np.zeros(len(names), dtype=int)
    return People(mean[0] - mean[1], design, asked, strides, within, freedom, group, periodic)


def _unpaired(cells: _Cells, sides: Sequence[Sequence[str]], periodic: bool) -> People:
    group = np.repeat([0, 1], [len(side) for side in sides])
    rows = [(name, condition) for condition in (0, 1) for name in sides[condition]]
    mean, count, squares = (
        np.array(part) for part in zip(*(cells.mean(*row) for row in rows), strict=True)
    )
    covariates = np.array([cells.covariate(*row) for row in rows])
    design = np.column_stack([np.eye(2)[group], covariates - covariates.mean(axis=0)])
    asked = np.zeros(design.shape[1])
    asked[:2] = 1.0, -1.0
    apart = np.eye(2, dtype=bool)[group].T[:, :, None]
    strides, within, freedom = of_strides(np.where(apart, squares, 0.0), np.where(apart, count, 0))
    return People(mean, design, asked, strides, within, freedom, group, periodic)


def of_strides(
    squares: Float[np.ndarray, "c n t"], count: np.ndarray
) -> tuple[Float[np.ndarray, "n d t"], Float[np.ndarray, "d t"], Float[np.ndarray, "d t"]]:
    """Return 1 / K, and what strides tell of their variance: of all where each tells little."""
    strides = np.moveaxis(np.where(count > 0, 1.0 / np.maximum(count, 1), 0.0), 0, 1)
    within, freedom = squares.sum(axis=1), np.maximum(count - 1.0, 0.0).sum(axis=1)
    if freedom.min() < APART:
        strides = strides.sum(axis=1, keepdims=True)
        within, freedom = (a.sum(axis=0, keepdims=True) for a in (within, freedom))
    return strides, within, freedom


def _check_enough(people: People, axis: str, paired: bool) -> None:
    seen = np.isfinite(people.value)
    spare = seen.sum(axis=0) - people.design.shape[1]
    sizes = [seen[people.group == one].sum(axis=0) for one in np.unique(people.group)]
    least = PAIRED if paired else UNPAIRED
    if np.min(sizes) < least or spare.min() < PAIRED - 1:
        need = (
            f"{PAIRED} people in both conditions"
            if paired
            else (f"{UNPAIRED} people in each condition, and {PAIRED + 1} in all")
        )
        raise InputError(
            "the comparison", f"there are too few people at some {axis}",
            f"It needs {need}, and one more for each covariate; or leave that {axis} out",
        )  # fmt: skip
