"""HDM05: five actors, each task performed several times, as cut clips.

Müller, Röder, Clausen, Eberhardt, Krüger, Weber (2007), Documentation: Mocap Database
HDM05, Technical Report CG-2007-2, Universität Bonn; CC BY-SA 3.0. The clips are
published as one archive, on a server that turns programs away: fetching it is left to
the user.
"""

import re
from collections.abc import Collection, Sequence
from pathlib import Path

import xarray as xr

from ...errors import InputError
from ..io.amc import read_amc
from ..io.asf import read_asf
from ..joining import concat
from ..skeleton import Skeleton
from .fetching import folders

HDM05_PAGE = "https://resources.mpi-inf.mpg.de/HDM05/"
_NAME = re.compile(
    r"HDM_(?P<actor>[a-z]+)_(?P<task>\w+)_(?P<repetition>\d+)_(?P<rate>\d+)\.amc", re.IGNORECASE
)


def hdm05(
    actors: str | Collection[str] | None = None,
    tasks: str | Collection[str] | None = None,
    root: str | Path | None = None,
) -> xr.Dataset:
    """Read cut clips of HDM05.

    Parameters
    ----------
    actors
        One or several of bd, bk, dg, mm, tr; all that are there by default.
    tasks
        One or several tasks such as ``"squat1Reps"``; all that are there by default.
    root
        Folder of the files, looked into first. How they are arranged in it does not matter.

    Returns
    -------
    Motion with the labels subject (the actor), task and repetition. The actors' bone
    lengths differ and give them away; only angles are fit for recognising people.

    Raises
    ------
    InputError
        If there are no such clips, an actor's skeleton is missing or a file cannot be used.
    """
    files = hdm05_files(actors, tasks, root)
    bodies: dict[str, Skeleton] = {}
    parts = []
    for path, (actor, task, repetition, rate) in files.items():
        if actor not in bodies:
            bodies[actor] = read_asf(_skeleton_file(path, actor, root))
        labels = {"subject": actor, "task": task, "repetition": repetition}
        parts.append(read_amc(path, bodies[actor], frame_rate=float(rate), labels=labels))
    return concat(parts)


def hdm05_files(
    actors: str | Collection[str] | None = None,
    tasks: str | Collection[str] | None = None,
    root: str | Path | None = None,
) -> dict[Path, tuple[str, str, str, str]]:
    """List the cut clips of HDM05 that are there, without reading them.

    Parameters
    ----------
    actors, tasks, root
        As in `hdm05`.

    Returns
    -------
    ``{path: (actor, task, repetition, frames a second)}`` as the file's name says,
    sorted by actor, task and repetition.

    Raises
    ------
    InputError
        If there is no folder with such files, or an actor or task is not among them.
    """
    places = folders("hdm05", root)
    found: dict[Path, tuple[str, str, str, str]] = {}
    for folder in places:
        for path in folder.rglob("*"):
            if match := _NAME.fullmatch(path.name):
                found[path] = (match["actor"], match["task"], match["repetition"], match["rate"])
        if found:
            break
    if not found:
        raise _missing(places, "there are no clips called like HDM_bd_squat1Reps_001_120.amc")
    chosen = [_choose("actor", actors, {name[0] for name in found.values()})]
    chosen.append(_choose("task", tasks, {name[1] for name in found.values()}))
    kept = {path: n for path, n in found.items() if n[0] in chosen[0] and n[1] in chosen[1]}
    if not kept:
        raise InputError(
            "HDM05",
            f"{', '.join(sorted(chosen[0]))} did not perform {', '.join(sorted(chosen[1]))}",
            "Ask for other actors or tasks",
        )
    return dict(sorted(kept.items(), key=lambda item: item[1]))


def _skeleton_file(clip: Path, actor: str, root: str | Path | None) -> Path:
    """Find an actor's skeleton: beside the clip, else anywhere in the folders."""
    name = f"hdm_{actor}.asf".lower()
    places = folders("hdm05", root)
    for folder, pattern in ((clip.parent, "*"), *((folder, "**/*") for folder in places)):
        for path in sorted(folder.glob(pattern)):
            if path.name.lower() == name:
                return path
    raise _missing(places, f"there is no skeleton HDM_{actor}.asf for {clip.name}")


def _missing(places: Sequence[Path], what: str) -> InputError:
    """Say where HDM05 is to be had."""
    return InputError(
        "HDM05",
        f"{what} in {', '.join(map(str, places))}",
        f"Fetch the cut clips (HDM05_cut_amc.zip) and the actors' ASF files from {HDM05_PAGE} with "
        f"a browser, which has to be done by hand, and unpack them in {places[-1]}",
    )


def _choose(what: str, wanted: str | Collection[str] | None, there: set[str]) -> set[str]:
    """Choose among what is there; a name that is not there is an error."""
    wanted = there if wanted is None else {wanted} if isinstance(wanted, str) else set(wanted)
    if not wanted or not wanted <= there:
        raise InputError(
            f"HDM05 {what} {', '.join(sorted(wanted - there)) or '(none)'}",
            "there are no such clips",
            f"Use some of {', '.join(sorted(there))}",
        )
    return wanted
