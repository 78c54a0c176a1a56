"""Motion as a plain `xarray.Dataset`: clips one after the other along `frame`.

Data variables
    ``angle`` (frame, dof)
        Joint angles in radians, NaN where a clip's skeleton lacks the degree of freedom.
    ``root_position`` (frame, space)
        Path of the root in the length unit of the clip's skeleton.
    ``position`` (frame, joint, space)
        Instead of the two above where only markers are known (C3D).

Coordinates
    ``frame`` counts 0..N-1; ``clip``, ``subject``, ``skeleton`` and any further
    label such as ``gait`` are texts on ``frame`` ("" means unknown); ``time`` is in
    seconds from the clip's first frame; ``dof`` holds labels ``joint/rx``; ``space``
    is x, y, z.

Attributes
    ``frame_rate`` in Hz; ``skeletons`` (JSON text, name to skeleton); ``source``
    (JSON text, clip to where it came from); ``history`` (text, one line a step).
"""

import json
import re
from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import InputError
from .skeleton import Skeleton

SPACE = ("x", "y", "z")
# Names that have a meaning of their own, in a Motion or in models of it.
OWN = frozenset({"clip", "skeleton", "time", "frame", "dof", "joint", "space"})
RESERVED = OWN | {"angle", "root_position", "position", "content"}
# No name of a variable in a file, and no text in one, can hold these.
UNWRITABLE = re.compile(r"[\x00-\x1f\x7f]")


def make_motion(
    skeleton: Skeleton,
    angle: Float[np.ndarray, "frame dof"],
    root_position: Float[np.ndarray, "_frame space"],
    *,
    frame_rate: float,
    clip: str,
    labels: Mapping[str, str] | None = None,
    source: str = "",
    history: str = "",
    allow_missing: bool = False,
) -> xr.Dataset:
    """Make the Motion of one clip.

    Parameters
    ----------
    skeleton
        Its `dofs` name the columns of `angle`.
    angle
        Angles in radians, at least one frame.
    root_position
        Root positions in the skeleton's length unit.
    frame_rate
        Frames a second.
    clip
        Name of the clip, unique among the clips it is to be joined with.
    labels
        What is known of the clip, for example ``{"subject": "02", "gait": "walk"}``.
    source
        Where the clip came from, for the reader of the data set.
    history
        What was done to it already, one line a step.
    allow_missing
        Whether NaN may stand for what was not measured.

    Raises
    ------
    InputError
        If shapes disagree, a value is not finite or the rate is not positive.
    """
    _check_columns(clip, skeleton, angle, root_position)
    _check_values(clip, {"angle": angle, "root position": root_position}, allow_missing)
    return _assemble(
        {"angle": (("frame", "dof"), angle), "root_position": (("frame", "space"), root_position)},
        {"dof": np.array(skeleton.dofs, dtype=np.str_)},
        frame_rate=frame_rate,
        clip=clip,
        labels=labels,
        skeleton=skeleton.name,
        attrs={
            "skeletons": json.dumps({skeleton.name: json.loads(skeleton.to_json())}),
            "source": json.dumps({clip: source}),
            "history": history,
        },
    )


def make_markers(
    names: Sequence[str],
    position: Float[np.ndarray, "frame joint space"],
    *,
    frame_rate: float,
    clip: str,
    metres: float | None = None,
    labels: Mapping[str, str] | None = None,
    source: str = "",
    history: str = "",
) -> xr.Dataset:
    """Make the Motion of one clip of which only marker positions are known.

    Parameters
    ----------
    names
        Labels of the markers.
    position
        Positions of the markers, NaN where a marker was not seen.
    metres
        Metres in the unit of `position`, None where that is not known.
    frame_rate, clip, labels, source, history
        As in `make_motion`.

    Raises
    ------
    InputError
        If shapes disagree, a position is infinite or the rate is not positive.
    """
    if position.shape[1:] != (len(names), 3) or not len(position):
        raise InputError(
            f"clip {clip!r}",
            f"positions have the shape {position.shape}, for {len(names)} markers",
            "Give an array (frame, marker, 3) of at least one frame",
        )
    _check_values(clip, {"position": position}, allow_missing=True)
    attrs: dict[str, object] = {
        "skeletons": "{}",
        "source": json.dumps({clip: source}),
        "history": history,
    }
    if metres is not None:
        attrs["metres"] = float(metres)
    return _assemble(
        {"position": (("frame", "joint", "space"), position)},
        {"joint": np.array(names, dtype=np.str_)},
        frame_rate=frame_rate,
        clip=clip,
        labels=labels,
        skeleton="",
        attrs=attrs,
    )


def skeletons(motion: xr.Dataset) -> dict[str, Skeleton]:
    """Give the skeletons of a Motion by name (none where only markers are known)."""
    stored = json.loads(motion.attrs["skeletons"])
    return {name: Skeleton.from_json(json.dumps(fields)) for name, fields in stored.items()}


def skeleton_of(motion: xr.Dataset) -> Skeleton:
    """Give the skeleton of a Motion that has a single one.

    Raises
    ------
    InputError
        If the clips have several skeletons, or none but markers.
    """
    require_angles(motion)
    used = list(dict.fromkeys(motion["skeleton"].values.tolist()))
    if len(used) != 1 or not used[0]:
        raise InputError(
            f"clips {', '.join(clips(motion))}",
            f"one skeleton is needed, there are {len([name for name in used if name])}",
            "Choose clips of one skeleton, for example with split(motion)[clip]",
        )
    return skeletons(motion)[used[0]]


def require_angles(motion: xr.Dataset) -> None:
    """Refuse a Motion of which only positions of markers are known, where angles are needed.

    Raises
    ------
    InputError
        If it has no joint angles.
    """
    if "angle" not in motion or "root_position" not in motion:
        raise InputError(
            f"clips {', '.join(clips(motion))}",
            "they have positions of markers alone, and joint angles are needed here",
            "Find the angles of a skeleton by inverse kinematics, as OpenSim or Blender do, and "
            "give these; markers can be checked, joined and drawn",
        )


def clips(motion: xr.Dataset) -> list[str]:
    """Give the names of the clips in their order."""
    return list(dict.fromkeys(motion["clip"].values.tolist()))


def label_names(motion: xr.Dataset) -> list[str]:
    """Give the names of the text labels on `frame` beside clip and skeleton."""
    return [
        str(name)
        for name, coordinate in motion.coords.items()
        if coordinate.dims == ("frame",) and name not in OWN
    ]


def check_labels(where: object, labels: Mapping[str, str]) -> None:
    """Refuse labels that a Motion, or a file of it, cannot hold.

    Parameters
    ----------
    where
        What bears them, for the error.
    labels
        Text by name.

    Raises
    ------
    InputError
        If a name is empty, has a slash or has a meaning of its own, or a name or a text has
        control characters.
    """
    for name, text in labels.items():
        if not name or name in RESERVED or "/" in name or UNWRITABLE.search(name):
            raise InputError(
                where, f"no label can be called {name!r}",
                f"Call it something without slashes, and not {', '.join(sorted(RESERVED))}",
            )  # fmt: skip
        if UNWRITABLE.search(text):
            raise InputError(where, f"the {name} {text!r} has control characters", "Remove them")


def add_history(motion: xr.Dataset, line: str) -> xr.Dataset:
    """Give the Motion with one line more in its history."""
    return motion.assign_attrs(history=f"{motion.attrs['history']}\n{line}".strip())


def _assemble(
    variables: dict,
    columns: dict,
    *,
    frame_rate: float,
    clip: str,
    labels: Mapping[str, str] | None,
    skeleton: str,
    attrs: dict,
) -> xr.Dataset:
    """Put one clip's arrays, labels and attributes together."""
    if not (np.isfinite(frame_rate) and frame_rate > 0):
        raise InputError(
            f"clip {clip!r}", f"the frame rate is {frame_rate}", "Give the frames a second"
        )
    labels = {"subject": "", **(labels or {})}
    if not clip:
        raise InputError("clip ''", "it has no name", "Name the clip")
    check_labels(f"clip {clip!r}", labels)
    frames = len(next(iter(variables.values()))[1])
    texts = {"clip": clip, "skeleton": skeleton, **labels}
    coords = {name: ("frame", np.full(frames, str(text))) for name, text in texts.items()}
    return xr.Dataset(
        {
            name: (dims, np.array(data, dtype=np.float64))
            for name, (dims, data) in variables.items()
        },
        coords={
            "frame": np.arange(frames),
            "time": ("frame", np.arange(frames) / frame_rate),
            "space": np.array(SPACE),
            **columns,
            **coords,
        },
        attrs={"frame_rate": float(frame_rate), **attrs},
    )


def _check_columns(clip: str, skeleton: Skeleton, angle: np.ndarray, root: np.ndarray) -> None:
    """Refuse arrays that do not fit the skeleton or each other."""
    wanted = len(skeleton.dofs)
    if angle.shape[1] != wanted:
        raise InputError(
            f"clip {clip!r}",
            f"{angle.shape[1]} columns of angles, but skeleton {skeleton.name!r} has {wanted}",
            "Give the columns in the order of skeleton.dofs",
        )
    if root.shape != (len(angle), 3) or not len(angle):
        raise InputError(
            f"clip {clip!r}",
            f"{len(angle)} frames of angles and root positions of the shape {root.shape}",
            "Give (frame, dof) and (frame, 3) with the same number of frames, at least one",
        )


def _check_values(clip: str, arrays: Mapping[str, np.ndarray], allow_missing: bool) -> None:
    """Refuse infinite values, and missing ones unless they are allowed."""
    for name, values in arrays.items():
        bad = np.isinf(values) if allow_missing else ~np.isfinite(values)
        if bad.any():
            raise InputError(
                f"clip {clip!r}, frame {np.argwhere(bad)[0][0]}",
                f"the {name} is {values[bad][0]}",
                "Leave the frame out, or say allow_missing=True for values not measured",
            )
