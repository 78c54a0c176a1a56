"""Curves over phase or time, such as one joint angle by stride: tables and arrays of them."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Float
from pandas.api.types import is_numeric_dtype

from ...errors import InputError

AXES = ("phase", "time")
STRIDE, SUBJECT = "stride", "subject"
# So many evenly spread phases (or times) curves have that were sampled at different ones.
POINTS = 101
# A table has curves as rows where so many names of its columns are numbers.
LEAST_POINTS = 3

Table = str | Path | pd.DataFrame | xr.DataArray | np.ndarray


def read_curves(
    source: Table, *, value: str = "value", labels: Mapping[str, Sequence[object]] | None = None,
    points: int | None = None,
) -> xr.DataArray:  # fmt: skip
    """Return curves over phase or time, one a stride, with their labels.

    Parameters
    ----------
    source
        One of

        - a csv file or table of pandas with the columns ``subject``, ``phase`` (or ``time``), and
          the value, one row a point. ``stride`` numbers the strides of a person in a condition;
          all other columns are labels of strides, ``condition`` or covariates such as ``speed``;
        - one with a row a stride: columns that are called by numbers are the phases, all others
          are labels;
        - an array of xarray with a dimension ``phase`` or ``time``; the coordinates of its other
          dimensions (``subject``, ``condition``, ``stride``, ...) are the labels;
        - an array (strides, phases), of phases in per cent, with ``labels``.

        NaN is missing; so is a stride of an array that is NaN throughout.
    value
        The column of the values, and what the curves are called.
    labels
        Of an array of NumPy, for each label one value a stride: ``{"subject": [...]}``.
    points
        Resample to so many evenly spread phases from the first to the last. If None the curves
        keep theirs where all have the same; otherwise there are 101.

    Returns
    -------
    The values (stride, phase or time), with the labels as coordinates of strides.

    Raises
    ------
    InputError
        If a file cannot be read, a column is missing, a point stands twice, labels differ within
        a stride, or there is no curve.

    Examples
    --------
    >>> import numpy as np
    >>> from bayesmotion.motion.io.curves import read_curves
    >>> labels = {"subject": ["ann", "ann", "ben"], "condition": ["slow", "fast", "slow"]}
    >>> read_curves(np.zeros((3, 101)), labels=labels).dims
    ('stride', 'phase')
    """
    if isinstance(source, xr.DataArray):
        curves = _of_array(source)
    elif isinstance(source, np.ndarray):
        curves = _of_numbers(source, labels or {})
    else:
        curves = _of_table(source, value)
    if labels is not None and not isinstance(source, np.ndarray):
        raise InputError("labels", "the source has its own", "Give them for arrays of NumPy alone")
    curves = curves.isel(stride=np.isfinite(curves.values).any(axis=1))
    if not curves.size:
        raise InputError(_name(source), "it has no curve", "Give numbers, and NaN where missing")
    if SUBJECT not in curves.coords:
        raise InputError(
            _name(source), "nothing says whose the strides are", f"Give a label {SUBJECT!r}"
        )
    if points is not None:
        axis = str(curves.dims[1])
        first, last = curves[axis].values[[0, -1]].tolist()
        curves = _resampled(curves, np.linspace(first, last, points), axis)
    return curves.rename(value)


def axis_of(curves: xr.DataArray) -> str:
    """Return ``phase`` or ``time``, whichever the curves go along.

    Raises
    ------
    InputError
        If they go along neither, or both.
    """
    found = [str(dim) for dim in curves.dims if dim in AXES]
    if len(found) != 1:
        raise InputError(
            "the curves", f"their dimensions are {', '.join(map(str, curves.dims))}",
            "Let one of them be phase, or time",
        )  # fmt: skip
    return found[0]


def _name(source: Table) -> str:
    return str(source) if isinstance(source, str | Path) else "the curves"


def _of_numbers(source: np.ndarray, labels: Mapping[str, Sequence[object]]) -> xr.DataArray:
    if source.ndim != 2:
        raise InputError("the curves", f"the array has {source.ndim} dimensions",
                         "Give strides as rows, and phases as columns")  # fmt: skip
    for name, values in labels.items():
        if len(values) != len(source):
            raise InputError(
                f"label {name!r}", f"{len(values)} values for {len(source)} strides",
                "Give one a stride",
            )  # fmt: skip
    coords = {name: (STRIDE, np.asarray(values)) for name, values in labels.items()}
    phase = np.linspace(0.0, 100.0, source.shape[1])
    return _made(np.asarray(source, dtype=float), "phase", phase, coords)


def _of_array(source: xr.DataArray) -> xr.DataArray:
    axis = axis_of(source)
    others = [dim for dim in source.dims if dim != axis]
    if others == [STRIDE]:
        flat = source.transpose(STRIDE, axis)
    else:
        renamed = source.rename({STRIDE: "number"}) if STRIDE in others else source
        dims = ["number" if dim == STRIDE else dim for dim in others]
        flat = renamed.stack({STRIDE: dims}).transpose(STRIDE, axis).reset_index(STRIDE)
    coords = {
        str(name): (STRIDE, coord.values)
        for name, coord in flat.coords.items()
        if coord.dims == (STRIDE,) and name != STRIDE
    }
    along = flat[axis].values if axis in flat.coords else np.linspace(0.0, 100.0, flat.shape[1])
    return _made(flat.values.astype(float), axis, along.astype(float), coords)


def _made(
    values: Float[np.ndarray, "k t"], axis: str, along: Float[np.ndarray, " t"],
    coords: Mapping[str, tuple[str, np.ndarray]],
) -> xr.DataArray:  # fmt: skip
    if np.any(np.diff(along) <= 0.0):
        raise InputError(f"the {axis} of curves", "it does not rise", "Sort the curves by it")
    return xr.DataArray(values, dims=(STRIDE, axis), coords={axis: along, **coords})


def _of_table(source: str | Path | pd.DataFrame, value: str) -> xr.DataArray:
    where = _name(source)
    if isinstance(source, pd.DataFrame):
        table = source
    else:
        try:
            table = pd.read_csv(source, dtype={SUBJECT: str, "condition": str})
        except (OSError, UnicodeDecodeError, ValueError) as error:
            raise InputError(where, f"it cannot be read ({error})", "Give a csv table") from error
    found = [axis for axis in AXES if axis in table.columns]
    if value in table.columns and len(found) == 1:
        return _of_long(table, value, found[0], where)
    numbers = [column for column in table.columns if _is_number(column)]
    if len(numbers) < LEAST_POINTS:
        raise InputError(
            where, f"its columns are {', '.join(map(str, table.columns))}",
            f"Name the value's {value!r} and the phase's 'phase' (or 'time'), or let phases be "
            "the names of columns",
        )  # fmt: skip
    along = np.array([float(column) for column in numbers])
    order = np.argsort(along)
    coords = {
        str(name): (STRIDE, table[name].to_numpy())
        for name in table.columns
        if name not in numbers and name != STRIDE
    }
    values = table[numbers].to_numpy(dtype=float)[:, order]
    return _made(values, "phase", along[order], coords)


def _is_number(column: object) -> bool:
    try:
        return bool(np.isfinite(float(str(column))))
    except ValueError:
        return False


def _of_long(table: pd.DataFrame, value: str, axis: str, where: str) -> xr.DataArray:
    for column in (value, axis):
        if not is_numeric_dtype(table[column]):
            raise InputError(where, f"its column {column!r} is not of numbers", "Mend it")
    labels = [column for column in table.columns if column not in (value, axis)]
    keys = [name for name in labels if name in (SUBJECT, STRIDE, "condition")]
    # What numbers strides is one of the keys; other labels belong to strides.
    if not keys:
        raise InputError(where, "nothing says whose the strides are", f"Name a column {SUBJECT!r}")
    groups = list(table.groupby(keys, sort=False, dropna=False))
    curves, told = [], []
    for key, rows in groups:
        name = ", ".join(map(str, key if isinstance(key, tuple) else (key,)))
        if len(rows[axis].unique()) < len(rows):
            raise InputError(
                f"{where}, {name}", f"a {axis} stands twice",
                f"Number the strides of a person in a column {STRIDE!r}",
            )  # fmt: skip
        differ = [label for label in labels if len(rows[label].unique()) > 1]
        if differ:
            raise InputError(
                f"{where}, {name}", f"{differ[0]} changes within the stride", "Leave it out"
            )
        ordered = rows.sort_values(axis)
        curves.append((ordered[axis].to_numpy(float), ordered[value].to_numpy(float)))
        told.append(rows.iloc[0][labels])
    coords = {
        str(name): (STRIDE, np.array([row[name] for row in told]))
        for name in labels
        if name != STRIDE
    }
    along = curves[0][0]
    if any(not np.array_equal(at, along) for at, _ in curves):
        along = np.linspace(min(a[0] for a, _ in curves), max(a[-1] for a, _ in curves), POINTS)
    values = np.stack([
        curve if np.array_equal(at, along) else np.interp(along, at, curve, np.nan, np.nan)
        for at, curve in curves
    ])  # fmt: skip
    return _made(values, axis, along, coords)


def _resampled(curves: xr.DataArray, along: Float[np.ndarray, " t"], axis: str) -> xr.DataArray:
    at = curves[axis].values
    values = np.stack([np.interp(along, at, curve) for curve in curves.values])
    coords = {
        str(name): (STRIDE, coord.values)
        for name, coord in curves.coords.items()
        if coord.dims == (STRIDE,)
    }
    return _made(values, axis, along, coords)
