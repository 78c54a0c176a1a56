"""Joining clips to one Motion and taking it apart again."""

import json
import warnings
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from ..errors import InputError, MotionWarning
from .dataset import clips, label_names, skeleton_of, skeletons
from .filters import clip_at

# How far apart rates may be that differ by the rounding of frame times: 1 / 0.033 s are 1 %
# beside 30 frames a second.
ROUNDED = 0.02
# Seconds that a frame time told in few digits is off these digits, at most.
ROUNDING = 1e-6


def concat(motions: Sequence[xr.Dataset]) -> xr.Dataset:
    """Join Motions along `frame`.

    Degrees of freedom (or markers) that a clip does not have are NaN there, and
    labels it does not have are "". Clips of different frame rates are brought to one by
    `filters.clip_at`, with a warning: to that of a whole number where they are within 2 %, else
    to the lowest. Where a frame time was rounded (0.033 s is one of 1/30 s) its frames are kept.

    Parameters
    ----------
    motions
        At least one Motion; all with angles or all with marker positions.

    Warns
    -----
    MotionWarning
        Of frame rates that differ.

    Raises
    ------
    InputError
        If there is none, length units differ, a clip name occurs twice,
        or two different skeletons bear the same name.
    """
    motions = list(motions)
    if not motions:
        raise InputError("concat", "there are no motions to join", "Give at least one")
    motions = _at_one_rate(motions)
    _check_kinds(motions)
    _check_names(motions)
    attrs = _joined_attrs(motions)
    names = list(dict.fromkeys(name for motion in motions for name in label_names(motion)))
    motions = [_with_missing_labels(motion.drop_attrs(), names) for motion in motions]
    joined = motions[0]
    if len(motions) > 1:
        joined = xr.concat(
            _with_all_columns(motions),
            dim="frame",
            data_vars="minimal",
            coords="minimal",
            compat="override",
            join="outer",
        )
    joined = joined.assign_coords(frame=np.arange(joined.sizes["frame"]))
    return joined.assign_attrs(attrs)


def split(motion: xr.Dataset) -> dict[str, xr.Dataset]:
    """Take a Motion apart into one Motion a clip.

    Each keeps only the degrees of freedom of its own skeleton, in the skeleton's
    order, and only the markers that were seen at least once.

    Parameters
    ----------
    motion
        Any Motion.
    """
    owners, known = motion["clip"].values, skeletons(motion)
    return {
        clip: _one(motion, clip, np.flatnonzero(owners == clip), known) for clip in clips(motion)
    }


def lengthened(motion: xr.Dataset, frames: int) -> xr.Dataset:
    """Return one clip followed by so many frames of which nothing is known (NaN).

    Labels, clip and skeleton stay those of its last frame; `time` (s) goes on.

    Parameters
    ----------
    motion
        Motion of one clip.
    frames
        How many frames come after it.
    """
    length = motion.sizes["frame"]
    number = np.arange(length + frames)
    longer = motion.isel(frame=np.minimum(number, length - 1)).assign_coords(frame=number)
    if "time" in longer.coords:
        time = motion["time"].values[0] + number / motion.attrs["frame_rate"]
        longer = longer.assign_coords(time=("frame", time))
    known = longer["frame"] < length
    kept = {
        name: variable.where(known) if "frame" in variable.dims else variable
        for name, variable in longer.data_vars.items()
    }
    return longer.assign(kept)


def shortened(motion: xr.Dataset) -> xr.Dataset:
    """Return clips without the frames that end them and of which nothing is known (NaN).

    Of a clip of which nothing is known at all the first two frames stay.
    """
    known = np.zeros(motion.sizes["frame"], bool)
    for variable in motion.data_vars.values():
        if "frame" in variable.dims:
            finite = np.isfinite(variable.transpose("frame", ...).values)
            known |= finite.reshape(len(known), -1).any(axis=1)
    names = motion["clip"].values
    kept = np.zeros(len(known), bool)
    for name in dict.fromkeys(names.tolist()):
        rows = np.flatnonzero(names == name)
        last = max([1, *np.flatnonzero(known[rows]).tolist()])
        kept[rows[: last + 1]] = True
    return motion if kept.all() else motion.isel(frame=kept)


def check_exportable(motion: xr.Dataset, kind: str) -> None:
    """Refuse what no file of one clip's angles can hold.

    Raises
    ------
    InputError
        If there are several clips, only markers, or values that are not finite.
    """
    names = clips(motion)
    if len(names) != 1 or "angle" not in motion:
        raise InputError(
            f"clips {', '.join(names)}",
            f"a {kind} file holds the angles of one clip",
            "Choose one with split(motion)[clip]; markers cannot be written",
        )
    skeleton = skeleton_of(motion)
    lacking = set(skeleton.dofs) - set(motion["dof"].values.tolist())
    if lacking:
        raise InputError(
            f"clip {names[0]!r}", f"{', '.join(sorted(lacking))} missing", "Keep all columns"
        )
    angle = motion["angle"].sel(dof=list(skeleton.dofs)).values
    bad = ~(np.isfinite(angle).all(1) & np.isfinite(motion["root_position"].values).all(1))
    if bad.any():
        raise InputError(
            f"clip {names[0]!r}, frame {np.flatnonzero(bad)[0]}",
            f"{bad.sum()} frames have missing values, which {kind} cannot say",
            "Fill them in or leave these frames out",
        )


def _one(motion: xr.Dataset, clip: str, rows: np.ndarray, known: Mapping) -> xr.Dataset:
    """Take out one clip, with what belongs to it and nothing else."""
    part = motion.isel(frame=rows).assign_coords(frame=np.arange(len(rows)))
    name = str(part["skeleton"].values[0])
    if "angle" in part:
        part = part.sel(dof=list(known[name].dofs))
    else:
        part = part.isel(joint=np.flatnonzero(part["position"].notnull().any(("frame", "space"))))
    kept = {name: json.loads(known[name].to_json())} if name else {}
    source = json.loads(motion.attrs["source"])
    return part.assign_attrs(
        skeletons=json.dumps(kept), source=json.dumps({clip: source.get(clip, "")})
    )


def _at_one_rate(motions: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Bring all motions to one frame rate."""
    rates = [float(motion.attrs["frame_rate"]) for motion in motions]
    if len(set(rates)) == 1:
        return list(motions)
    # Whole numbers are what cameras are set to.
    rate = next((rate for rate in rates if rate.is_integer()), rates[0])
    if any(abs(own - rate) > ROUNDED * rate for own in rates):
        rate = min(rates)
    others = ", ".join(f"{own:g}" for own in dict.fromkeys(rates) if own != rate)
    warnings.warn(
        f"clips of {others} frames a second are brought to {rate:g}, to be joined; give "
        "frame_rate if a file is wrong about it",
        MotionWarning,
        stacklevel=3,
    )
    return [_at(motion, rate) for motion in motions]


def _at(motion: xr.Dataset, rate: float) -> xr.Dataset:
    """Bring a motion to a frame rate, of which its own may be a rounded one."""
    own = float(motion.attrs["frame_rate"])
    if own == rate:
        return motion
    if any(abs(round(1.0 / rate, digits) - 1.0 / own) < ROUNDING for digits in (2, 3, 4, 5)):
        return with_rate(motion, rate)
    parts = split(motion).values()
    made = [clip_at(part, own / rate) for part in parts if part.sizes["frame"] > 1]
    made += [with_rate(part, rate) for part in parts if part.sizes["frame"] == 1]
    return concat([part.assign_attrs(frame_rate=rate) for part in made])


def with_rate(motion: xr.Dataset, rate: float) -> xr.Dataset:
    """Return the same frames as being so many a second.

    Raises
    ------
    InputError
        If that is no number of frames.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise InputError("frame rate", f"it is {rate:g}", "Give the frames a second")
    scale = float(motion.attrs["frame_rate"]) / rate
    time = motion["time"].copy(data=motion["time"].values * scale)
    return motion.assign_coords(time=time).assign_attrs(frame_rate=float(rate))


def _check_kinds(motions: Sequence[xr.Dataset]) -> None:
    """Refuse a mixture of length units, and of angles with markers."""
    for what, values in (
        ("units (metres)", [motion.attrs.get("metres") for motion in motions]),
        ("kinds of data", [" and ".join(map(str, motion.data_vars)) for motion in motions]),
    ):
        if any(value != values[0] for value in values):
            raise _differing(what, motions, values)


def _differing(what: str, motions: Sequence[xr.Dataset], values: Sequence[object]) -> InputError:
    """Make the error for clips of which the first that differs from the first is named."""
    odd = next(i for i, value in enumerate(values) if value != values[0])
    first, other = clips(motions[0])[0], clips(motions[odd])[0]
    return InputError(
        f"clips {first!r} and {other!r}",
        f"their {what} differ: {values[0]} and {values[odd]}",
        "Join only clips that agree",
    )


def _check_names(motions: Sequence[xr.Dataset]) -> None:
    """Refuse a clip name that occurs twice and a skeleton name with two meanings."""
    seen: set[str] = set()
    bodies: dict[str, object] = {}
    for motion in motions:
        for clip in clips(motion):
            if clip in seen:
                raise InputError(
                    f"clip {clip!r}", "two clips have this name", "Read one under another name"
                )
            seen.add(clip)
        for name, body in skeletons(motion).items():
            if bodies.setdefault(name, body) != body:
                raise InputError(
                    f"skeleton {name!r} of clip {clips(motion)[0]!r}",
                    "a different skeleton has the same name",
                    "Give one of the two another name",
                )


def _joined_attrs(motions: Sequence[xr.Dataset]) -> dict[str, object]:
    """Join the attributes; a line of history that all share stands once."""
    tables: dict[str, dict] = {"skeletons": {}, "source": {}}
    for motion in motions:
        for name, table in tables.items():
            table.update(json.loads(motion.attrs[name]))
    lines = [line for motion in motions for line in motion.attrs["history"].splitlines()]
    return {
        **motions[0].attrs,
        **{name: json.dumps(table) for name, table in tables.items()},
        "history": "\n".join(dict.fromkeys(lines)),
    }


def _with_missing_labels(motion: xr.Dataset, names: Sequence[str]) -> xr.Dataset:
    """Add the labels that other clips have, as unknown."""
    empty = np.full(motion.sizes["frame"], "")
    return motion.assign_coords(
        {name: ("frame", empty) for name in names if name not in motion.coords}
    )


def _with_all_columns(motions: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Give all motions the same columns, in the order in which they first occur."""
    dim = "dof" if "angle" in motions[0] else "joint"
    columns = list(dict.fromkeys(name for m in motions for name in m[dim].values.tolist()))
    return [motion.reindex({dim: columns}) for motion in motions]
