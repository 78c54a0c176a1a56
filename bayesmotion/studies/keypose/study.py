"""Reproduce Perera, Kudoh and Ikeuchi: keyposes, low-dimensional motion, recognition.

The paper's own dances are not public. Recognition is measured on HDM05 (5 persons, 11
tasks), keyposes on dances with known beats, and precision and recall on synthetic dances.

The study goes stage by stage, and what a stage found is written to ``keypose-stages.json``
before the next one begins; the recordings are read once, and their vectors kept beside it. A
run that was interrupted goes on from there. ``keypose.json`` holds the results of the stages
that it came to; pictures are drawn at the end.
"""

import functools
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from ...files import write_json
from ...motion.datasets.public import hdm05
from ..stages import Say, Stages
from . import dance as keypose_dance
from . import novelty as keypose_novelty
from . import recognition as keypose_recognition
from . import scores as keypose_scores
from . import synthetic as keypose_synthetic
from . import tucker as keypose_tucker
from . import vectors as keypose_vectors
from .figures import draw_figures
from .vectors import Vectors, read_vectors

# Perera, Kudoh and Ikeuchi, Tables 3 to 5, on their own dances.
PAPER = {
    "known": {"task": 47 / 48, "person": 42 / 48},
    "unseen": {"new_task": 22 / 24, "new_person": 20 / 24},
    "task_of_unseen_person": 10 / 12,
    "task_of_known_person": 11 / 12,
    "seconds_per_probe": 70.0,
}

Stage = Callable[[], dict[str, Any]]


def reproduce(data: Path | None, out: Path, say: Say = print, seed: int = 0) -> dict[str, Any]:
    """Make the tables and pictures, and write them to `out`.

    Parameters
    ----------
    data
        Folder that holds ``hdm05/`` and ``dance/``; where None, ``$BAYESMOTION_DATA``.
    out
        Folder for ``keypose.json`` and the pictures.
    say
        Called with a line after every stage.
    seed
        Of the shifts of the beats and of the draws.
    """
    stages = Stages(out / "keypose-stages.json", plan(seed), say)
    found = stages.result

    @functools.cache
    def vectors() -> Vectors:
        root = data / "hdm05" if data is not None else None
        found = read_vectors(stages.folder / "segments.nc", lambda: hdm05(root=root))
        stages.read(one_body=_values(found.one), own_body=_values(found.own))
        return found

    for name, work in _stages(data, vectors, lambda: found["choice"]["chosen"], seed):
        stages.do(*name.split("/"), work=work)
        write_json(out / "keypose.json", without_labels(assembled(found)))
    result = assembled(found)
    draw_figures(result, out)
    return without_labels(result)


def _values(segments: xr.DataArray) -> xr.Dataset:
    return segments.to_dataset(name="segments")


def plan(seed: int) -> dict[str, Any]:
    """The settings of the study."""
    return {
        "vectors": keypose_vectors.COEFFICIENTS,
        "recognition": {
            "channels": list(keypose_recognition.CHANNELS),
            "coefficients": list(keypose_recognition.COEFFICIENTS),
            "ranks": list(keypose_recognition.RANKS),
            "variants": keypose_recognition.VARIANTS,
            "bins": keypose_scores.BINS,
        },
        "unseen": keypose_novelty.novelty_plan(),
        "missing_cells": keypose_tucker.tucker_plan(),
        "dances": keypose_dance.dance_plan(),
        "synthetic": keypose_synthetic.synthetic_plan(),
        "seed": seed,
    }


def assembled(found: Mapping[str, Any]) -> dict[str, Any]:
    """Put what the stages found, all or those there are, into one table of results."""
    kept = ("settings", "made_with", "seconds")
    result: dict[str, Any] = {"paper": PAPER, **{name: found[name] for name in kept}}
    for name, part in found.items():
        if name in ("choice", "dances"):
            result |= {key: dict(value) if name == "dances" else value
                       for key, value in part.items()}  # fmt: skip
        elif name not in kept:
            result[name] = dict(part)
    for name in ("ms_per_probe", "ms_one_probe"):
        if "known" in result:
            result[name] = result["known"].pop(name)
    if "music" in result:
        result.setdefault("beats", {})["music"] = result.pop("music")
    if "unseen" in result:
        result["unseen"] = {
            kind: keypose_novelty.pooled(levels) for kind, levels in result["unseen"].items()
        }
    return result


def without_labels(result: dict[str, Any]) -> dict[str, Any]:
    """Leave out the labels of every probe, which are for the confusion matrices only."""
    if "known" not in result:
        return result
    known = {key: value for key, value in result["known"].items() if key not in ("named", "true")}
    return result | {"known": known}


def _stages(
    data: Path | None,
    vectors: Callable[[], Vectors],
    chosen: Callable[[], dict[str, Any]],
    seed: int,
) -> Iterator[tuple[str, Stage]]:
    """Give all stages in their order."""
    yield from keypose_recognition.stages(vectors, chosen).items()
    yield from keypose_novelty.stages(vectors, lambda: chosen()["coefficients"]).items()
    yield "missing_cells", lambda: keypose_tucker.run(vectors().of(**chosen()), seed)
    dances = functools.cache(lambda: keypose_dance.read_dances(data))
    yield "dances", lambda: keypose_dance.run(dances(), seed)
    yield "music", lambda: keypose_dance.music(data, dances(), seed)
    yield "synthetic", lambda: keypose_synthetic.run(seed)
