"""Trials of the CMU data base as studies name them: ``02_02``, ``06_01.bvh`` (BVH release)."""

from pathlib import Path

import xarray as xr

from ..motion import read_bvh
from ..motion.datasets.fetching import folders
from ..motion.datasets.public import cmu


def read_trial(trial: str, data: Path | None) -> xr.Dataset:
    """Return the Motion of a trial; of a BVH release the first frame, a rest pose, is left out.

    Parameters
    ----------
    trial
        Its name, with ``.bvh`` where the BVH release is meant.
    data
        Folder that holds ``cmu/``; where None as in `motion.datasets.public.cmu`.
    """
    root = None if data is None else data / "cmu"
    name, _, kind = trial.partition(".")
    if not kind:
        return cmu(name, root)
    subject = name.partition("_")[0]
    places = [folder / subject / trial for folder in folders("cmu", root)]
    path = next((place for place in places if place.is_file()), places[0])
    motion = read_bvh(path, labels={"subject": subject}, skip_first_frame=True)
    # The file tells the time of a frame in seven digits.
    return motion.assign_attrs(frame_rate=120.0)
