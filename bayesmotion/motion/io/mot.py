"""Joint angles in MOT files (OpenSim): one column a coordinate, and no skeleton."""

import re
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...errors import InputError, MotionWarning
from ...files import replacing
from ..dataset import make_motion, skeleton_of
from ..joining import check_exportable
from ..skeleton import Joint, Skeleton
from .asf import read_asf
from .rates import declared_rate, nominal
from .text import Line, number, read_lines, row_of

_ROTATION = re.compile(r"(.+)_(r[xyz])")
_FORCES = re.compile("force|torque|moment", re.IGNORECASE)


def read_mot(
    path: str | Path,
    skeleton: Skeleton | str | Path | None = None,
    *,
    frame_rate: float | None = None,
    clip: str | None = None,
    labels: Mapping[str, str] | None = None,
) -> xr.Dataset:
    """Read the joint angles of a MOT file.

    The file names coordinates, and says nothing of bones. With a skeleton, its columns are
    the skeleton's degrees of freedom, ``joint_rx`` for ``joint/rx``. Without, every coordinate
    becomes a joint of that name that turns about one axis, on bones without length: its angles
    can be modelled and compared, its positions are the root's.

    Parameters
    ----------
    path
        The file.
    skeleton
        The body whose angles these are, as `write_mot` wrote them, or its ASF file.
    frame_rate
        Frames a second, by default from the column of times.
    clip
        Name of the clip, by default the file's stem.
    labels
        What is known of the clip, for example its subject.

    Returns
    -------
    Motion of one clip, in radians; the first columns called ``..._tx``, ``..._ty``, ``..._tz``
    are the path of the root.

    Warns
    -----
    MotionWarning
        Of further columns that are lengths, which are left out.

    Raises
    ------
    InputError
        If the file is missing, broken, or holds forces; file and line are named.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> motion = bm.read("walk_ik.mot")  # doctest: +SKIP
    """
    path = Path(path)
    lines = [line for line in read_lines(path) if line.text]
    start = next((i for i, line in enumerate(lines) if line.text.lower() == "endheader"), None)
    if start is None or len(lines) < start + 3:
        raise InputError(
            path, "it is no MOT file: 'endheader' and rows are missing", "Give another"
        )
    degrees = _told(lines[:start], "inDegrees", ("yes", "no")) == "yes"
    head = lines[start + 1]
    names = row_of(head)
    _check_columns(head, names)
    values = np.array([_row(line, len(names)) for line in lines[start + 2 :]])
    if frame_rate is None:
        frame_rate = _rate(head, values[:, 0])
    along = [i for i, name in enumerate(names) if re.search(r"_t[xyz]$", name)]
    path_columns = _path_columns(head, names, along)
    root = values[:, path_columns] if path_columns else np.zeros((len(values), 3))
    turning = [i for i in range(1, len(names)) if i not in along]
    columns = [names[i] for i in turning]
    if skeleton is None:
        first = names[path_columns[0]].removesuffix("_tx") if path_columns else "ground"
        skeleton, order = _body(path.stem, columns, first)
    else:
        skeleton = skeleton if isinstance(skeleton, Skeleton) else read_asf(skeleton)
        order = _columns(skeleton)
        _check_body(head, columns, skeleton)
    angle = values[:, [turning[columns.index(name)] for name in order]]
    return make_motion(
        skeleton,
        np.radians(angle) if degrees else angle,
        root,
        frame_rate=frame_rate,
        clip=path.stem if clip is None else clip,
        labels=labels,
        source=path.name,
    )


def write_mot(motion: xr.Dataset, path: str | Path) -> None:
    """Write the joint angles of one clip as MOT, in degrees.

    A column is called ``joint_rx``, or like the joint alone where it has one rotation about z,
    as `read_mot` makes them; the root's path is ``..._tx``, ``..._ty``, ``..._tz``.

    Parameters
    ----------
    motion
        One clip without missing values.
    path
        File to write; it is the old one or the new one.

    Raises
    ------
    InputError
        If there are several clips, NaN, or only markers.
    """
    check_exportable(motion, "MOT")
    skeleton = skeleton_of(motion)
    root = re.sub(r"\s", "_", skeleton.joints[0].name)
    columns = ["time", *_columns(skeleton), *(f"{root}_t{axis}" for axis in "xyz")]
    angle = np.degrees(motion["angle"].sel(dof=list(skeleton.dofs)).values)
    time = np.arange(len(angle)) / motion.attrs["frame_rate"]
    values = np.hstack([time[:, None], angle, motion["root_position"].values])
    lines = [
        str(motion["clip"].values[0]),
        "version=1",
        f"nRows={len(values)}",
        f"nColumns={len(columns)}",
        "inDegrees=yes",
        "endheader",
        "\t".join(columns),
        *("\t".join(map(repr, row)) for row in values.tolist()),
    ]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _columns(skeleton: Skeleton) -> list[str]:
    """Give the names of the columns of angles."""
    names = [
        joint.name if joint.channels == ("rz",) and joint.parent >= 0 else f"{joint.name}_{channel}"
        for joint in skeleton
        for channel in joint.channels
    ]
    names = [re.sub(r"\s", "_", name) for name in names]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"column {twice[0]!r}", "two joints have it", "Rename one")
    return names


def _told(lines: Sequence[Line], key: str, words: Sequence[str]) -> str:
    """Read a word of the head."""
    for line in lines:
        name, _, word = line.text.partition("=")
        if name.strip().lower() == key.lower():
            if word.strip().lower() not in words:
                raise line.error(f"{line.text!r} is none of {', '.join(words)}", "Correct it")
            return word.strip().lower()
    raise lines[0].error(f"no line above endheader says {key}=", f"Add {key}={words[0]}")


def _check_columns(line: Line, names: Sequence[str]) -> None:
    """Refuse columns that are no angles, or of the same name."""
    if names[0].lower() != "time" or len(names) < 2:
        raise line.error("the first column is not 'time' with others behind it", "Add it")
    forces = [name for name in names if _FORCES.search(name)]
    if forces:
        raise line.error(
            f"{forces[0]!r} is a force, no joint angle", "Give the file of inverse kinematics"
        )
    for name in names:
        if not name or names.count(name) > 1:
            raise line.error(f"the column {name!r} stands twice", "Rename one")


def _row(line: Line, count: int) -> list[float]:
    """Read one frame."""
    cells = row_of(line)
    if len(cells) != count:
        raise line.error(f"{len(cells)} values for {count} columns", "Restore what is missing")
    return [number(line, cell) for cell in cells]


def _rate(line: Line, time: Float[np.ndarray, " frame"]) -> float:
    """Give the frame rate that the times tell.

    Raises
    ------
    InputError
        If they do not tell it, being one, or do not rise evenly.
    """
    where, steps = f"{line.path}:{line.number}", np.diff(time)
    usual = float(np.median(steps)) if steps.size else 0.0
    if usual <= 0 or np.abs(steps - usual).max() > 0.1 * usual:
        raise InputError(
            where, "the times do not rise evenly", "Resample it, or give frame_rate (--frame-rate)"
        )
    rate = float(len(steps) / (time[-1] - time[0]))
    return nominal(declared_rate(where, rate, f"a step of {usual:g} s"))


def _path_columns(line: Line, names: Sequence[str], along: Sequence[int]) -> list[int]:
    """Choose the columns of the root's path among those that are lengths."""
    first = next((names[i].removesuffix("x") for i in along if names[i].endswith("x")), "")
    path = [i for axis in "xyz" for i in along if names[i] == f"{first}{axis}"]
    path = path if len(path) == 3 else []
    others = [names[i] for i in along if i not in path]
    if others:
        warnings.warn(
            f"{line.path}:{line.number}: {', '.join(others)} left out: only the root moves along",
            MotionWarning,
            stacklevel=4,
        )
    return path


def _body(name: str, columns: Sequence[str], root: str) -> tuple[Skeleton, list[str]]:
    """Make the skeleton that has these columns, on bones without length, and their order."""
    turns: dict[str, list[tuple[str, str]]] = {root: []}
    for column in columns:
        found = _ROTATION.fullmatch(column)
        joint, channel = (found[1], found[2]) if found else (column, "rz")
        # One rotation about z is called like its joint.
        alone = channel == "rz" and not {f"{joint}_rx", f"{joint}_ry"} & set(columns)
        turns.setdefault(column if alone and joint != root else joint, []).append((channel, column))
    joints = [
        Joint(joint, min(index, 1) - 1, (0.0, 0.0, 0.0), channels=tuple(one for one, _ in found))
        for index, (joint, found) in enumerate(turns.items())
    ]
    order = [column for found in turns.values() for _, column in found]
    return Skeleton(name, tuple(joints), metres=1.0), order


def _check_body(line: Line, columns: Sequence[str], skeleton: Skeleton) -> None:
    """Refuse columns that are not the degrees of freedom of a skeleton."""
    odd = set(_columns(skeleton)) ^ set(columns)
    if odd:
        raise line.error(
            f"the columns are not those of skeleton {skeleton.name!r}: {sorted(odd)[0]!r}",
            "Give the skeleton of this recording",
        )
