"""Names of clips and skeletons that are alike in several files, told apart by folder."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from ..dataset import clips


def with_distinct_names(paths: Sequence[Path], motions: Sequence[xr.Dataset]) -> list[xr.Dataset]:
    """Return what was read of files with names of clips and skeletons that occur once.

    A clip called as one of another file, or a skeleton called as a different one, gets the
    name of its file's folder in front, as in ``monday/walk_01``: as many folders as it takes.

    Parameters
    ----------
    paths
        The files.
    motions
        What each of them holds.
    """
    parts = [_clips_and_skeletons(motion) for motion in motions]
    named = Counter(clip for own, _ in parts for clip in own)
    bodies: dict[str, set[str]] = {}
    for _, own in parts:
        for name, body in own.items():
            bodies.setdefault(name, set()).add(body)
    doubled = {clip for clip, count in named.items() if count > 1}
    unlike = {name for name, known in bodies.items() if len(known) > 1}
    if not doubled and not unlike:
        return list(motions)
    folders = _distinct_folders(
        paths, [bool(doubled & {*own} or unlike & {*skeletons}) for own, skeletons in parts]
    )
    if folders is None:
        return list(motions)
    return [
        _renamed(
            motion,
            {clip: f"{folder}/{clip}" for clip in own if clip in doubled},
            {name: f"{folder}/{name}" for name in skeletons if name in unlike},
        )
        for motion, folder, (own, skeletons) in zip(motions, folders, parts, strict=True)
    ]


def _clips_and_skeletons(motion: xr.Dataset) -> tuple[list[str], dict[str, str]]:
    bodies = json.loads(motion.attrs["skeletons"])
    return clips(motion), {name: json.dumps(body) for name, body in bodies.items()}


def _distinct_folders(paths: Sequence[Path], concerned: Sequence[bool]) -> list[str] | None:
    """Return the last folders of every path, as many as tell those concerned apart.

    None where no folder does: one file twice, or files of one folder and stem.
    """
    parents = [path.resolve().parent.parts for path in paths]
    stems = [path.stem for path in paths]
    for depth in range(1, max(map(len, parents)) + 1):
        found = ["/".join(parent[-depth:]) for parent in parents]
        named = [pair for pair, told in zip(zip(found, stems, strict=True), concerned,
                                            strict=True) if told]  # fmt: skip
        if len(set(named)) == len(named):
            return found
    return None


def _renamed(
    motion: xr.Dataset, clip_names: Mapping[str, str], skeleton_names: Mapping[str, str]
) -> xr.Dataset:
    """Return a Motion whose clips and skeletons have other names."""
    bodies = json.loads(motion.attrs["skeletons"])
    sources = json.loads(motion.attrs["source"])
    coords = {
        key: ("frame", np.array([names.get(name, name) for name in motion[key].values.tolist()]))
        for key, names in (("clip", clip_names), ("skeleton", skeleton_names))
    }
    return motion.assign_coords(coords).assign_attrs(
        skeletons=json.dumps(
            {
                skeleton_names.get(name, name): {**body, "name": skeleton_names.get(name, name)}
                for name, body in bodies.items()
            }
        ),
        source=json.dumps({clip_names.get(clip, clip): text for clip, text in sources.items()}),
    )
