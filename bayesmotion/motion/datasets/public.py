"""Public recordings by name: the CMU data base and HDM05.

Files are looked for in the folder given, then in ``$BAYESMOTION_DATA/cmu`` or
``hdm05``, then in the user's cache. What is still missing of CMU is downloaded to
the cache. Nothing of either data base is part of this package.

CMU Graphics Lab motion capture: mocap.cs.cmu.edu, free for all uses. To be
acknowledged as: "The data used in this project was obtained from mocap.cs.cmu.edu.
The database was created with funding from NSF EIA-0196217." HDM05: see `hdm05_clips`.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import xarray as xr

from ...errors import InputError
from ..io.amc import read_amc
from ..io.asf import read_asf
from ..io.labels import Labels, read_labels, with_labels
from ..joining import concat
from ..skeleton import Skeleton
from .cmu_registry import SHA256
from .fetching import fetch, folders
from .hdm05_clips import hdm05, hdm05_files

__all__ = ["CMU_URL", "cmu", "hdm05", "hdm05_files"]

CMU_URL = "http://mocap.cs.cmu.edu/subjects"
_TRIAL = re.compile(r"(\d{2,3})_\d{2,3}")


def cmu(
    trials: str | Sequence[str],
    root: str | Path | None = None,
    *,
    labels: Labels | Mapping[str, Mapping[str, str]] | str | Path | None = None,
    base_url: str = CMU_URL,
) -> xr.Dataset:
    """Read trials of the CMU motion capture data base, fetching what is not there.

    Parameters
    ----------
    trials
        ``"02_02"`` or several: the number of the subject and that of the trial.
    root
        Folder that holds ``02/02.asf`` and ``02/02_02.amc``, looked into first.
    labels
        Labels of the clips, as `read` takes them: a csv file, what `read_labels`
        gave, or ``{"02_02": {"gait": "walk"}}``. The subject is known already.
    base_url
        Where the files are published.

    Returns
    -------
    Motion of 120 frames a second with one clip a trial, labelled with the subject's
    number.

    Raises
    ------
    InputError
        If a trial is not called like one, a folder or file is missing and cannot be
        downloaded, or a file cannot be used.
    """
    trials = [trials] if isinstance(trials, str) else list(trials)
    if not trials:
        raise InputError("trials", "there are none", "Name at least one, such as '02_02'")
    for trial in trials:
        if not _TRIAL.fullmatch(trial):
            raise InputError(f"trial {trial!r}", "no CMU trial is called so", "Write it as '02_02'")
    places = folders("cmu", root)
    bodies: dict[str, Skeleton] = {}
    parts = []
    for trial in trials:
        subject = trial.partition("_")[0]
        if subject not in bodies:
            bodies[subject] = read_asf(_cmu_file(places, subject, f"{subject}.asf", base_url))
        path = _cmu_file(places, subject, f"{trial}.amc", base_url, bodies[subject])
        parts.append(read_amc(path, bodies[subject], labels={"subject": subject}))
    motion = concat(parts)
    if labels is None:
        return motion
    return with_labels(motion, read_labels(labels) if isinstance(labels, str | Path) else labels)


def _cmu_file(
    places: Sequence[Path],
    subject: str,
    name: str,
    base_url: str,
    skeleton: Skeleton | None = None,
) -> Path:
    """Find a file of a subject, or fetch it to the cache, the last of the folders."""
    for folder in places:
        if (folder / subject / name).is_file():
            return folder / subject / name

    def check(path: Path) -> object:
        return read_asf(path) if skeleton is None else read_amc(path, skeleton)

    url = f"{base_url.rstrip('/')}/{subject}/{name}"
    try:
        return fetch(url, places[-1] / subject / name, check=check, sha256=SHA256.get(name))
    except InputError as error:
        what = "skeleton" if skeleton is None else "motion"
        looked = ", ".join(str(folder / subject) for folder in places)
        raise InputError(
            f"CMU {name}",
            f"there is no such {what} in {looked}, and {url} gave none: {error.what}",
            error.mend,
        ) from error
