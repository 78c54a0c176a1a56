"""Whether a data set is a Motion: asked of files, which anybody may have written."""

import json
from collections.abc import Mapping

import numpy as np
import xarray as xr

from ..errors import InputError
from .dataset import OWN, SPACE, check_labels, clips, label_names, skeletons

MEND = "Give a file written by save()"


def require_motion(motion: xr.Dataset, where: object) -> None:
    """Refuse a data set that is no Motion, in names, dimensions, types or values.

    Parameters
    ----------
    motion
        The data set.
    where
        The file, for the error.

    Raises
    ------
    InputError
        If it is none.
    """
    missing = [name for name in ("frame_rate", "skeletons", "source") if name not in motion.attrs]
    missing += [name for name in ("clip", "skeleton", "time") if name not in motion.coords]
    if missing:
        raise InputError(where, f"{', '.join(missing)} missing", MEND)
    _require_attributes(motion, where)
    _require_variables(motion, where)
    _require_coordinates(motion, where)
    known = skeletons(motion)
    used = dict.fromkeys(motion["skeleton"].values.tolist())
    for name in used if "angle" in motion else ():
        if name not in known:
            raise InputError(where, f"the skeleton {name!r} is not described", MEND)
        lacking = set(known[name].dofs) - set(motion["dof"].values.tolist())
        if lacking:
            raise InputError(where, f"{', '.join(sorted(lacking))} missing", "Keep all columns")


def _require_attributes(motion: xr.Dataset, where: object) -> None:
    for name in ("frame_rate", "metres"):
        value = motion.attrs.get(name, 1.0)
        number = isinstance(value, int | float | np.number) and np.isfinite(float(value))
        if not number or not float(value) > 0:
            raise InputError(where, f"the attribute {name} is {value!r}", MEND)
    for name in ("skeletons", "source"):
        try:
            described = json.loads(str(motion.attrs[name]))
        except (ValueError, RecursionError) as error:
            raise InputError(where, f"the attribute {name} is damaged ({error})", MEND) from error
        if not isinstance(described, Mapping):
            raise InputError(where, f"the attribute {name} is no table", MEND)
    if not isinstance(motion.attrs.get("history", ""), str):
        raise InputError(where, "its history is no text", MEND)


def _require_variables(motion: xr.Dataset, where: object) -> None:
    shapes = {"angle": ("frame", "dof"), "root_position": ("frame", "space")}
    if "position" in motion:
        shapes = {"position": ("frame", "joint", "space")}
    found = {str(name): array.dims for name, array in motion.data_vars.items()}
    # There may be more, such as the beats of a dance.
    if not shapes.items() <= found.items() or motion.sizes["frame"] < 1:
        raise InputError(
            where, f"it has the variables {', '.join(map(str, found)) or 'none'}, or they have "
            "other dimensions than those of a Motion", MEND,
        )  # fmt: skip
    for name in shapes:
        array = motion[name]
        if array.dtype != np.float64 or np.isinf(array.values).any():
            raise InputError(where, f"{name} holds what is no number", MEND)


def _require_coordinates(motion: xr.Dataset, where: object) -> None:
    time = motion["time"]
    if time.dims != ("frame",) or time.dtype != np.float64 or not np.isfinite(time.values).all():
        raise InputError(where, "time is not in seconds, one a frame", MEND)
    if "frame" not in motion.coords or motion["frame"].dtype.kind != "i":
        raise InputError(where, "frames are not counted", MEND)
    if "space" not in motion.coords or tuple(motion["space"].values.tolist()) != SPACE:
        raise InputError(where, "space is not x, y, z", MEND)
    labels = [name for name in label_names(motion) if motion[name].dtype.kind in "OU"]
    texts = ["clip", "skeleton", *labels]
    columns = ["dof"] if "angle" in motion else ["joint"]
    for name in [*texts, *columns]:
        dims = (name,) if name in columns else ("frame",)
        if name not in motion.coords or motion[name].dims != dims or not _text(motion[name]):
            raise InputError(where, f"{name} is no text, or not one for each", MEND)
    for name in columns:
        if len(set(motion[name].values.tolist())) != motion.sizes[name]:
            raise InputError(where, f"two columns have the same name ({name})", MEND)
    for name in texts:
        for text in dict.fromkeys(motion[name].values.tolist()):
            check_labels(where, {"label" if name in OWN else name: text})
    if "" in clips(motion):
        raise InputError(where, "a clip has no name", MEND)


def _text(array: xr.DataArray) -> bool:
    return array.dtype.kind == "U" or all(isinstance(text, str) for text in array.values.tolist())
