"""Reproduce Perera, Kudoh and Ikeuchi: keyposes, low-dimensional motion, recognition.

The paper's own dances are not public. Recognition is measured on HDM05 (5 persons, 11
tasks), keyposes on dances with known beats, and precision and recall on synthetic dances.

The study goes stage by stage, and what a stage found is written to ``keypose.json.part``
before the next one begins; the recordings are read once, and their vectors kept beside it.
A run that was interrupted goes on from there when it is begun again with the same seed.
``keypose.json`` holds the results of the stages that it came to; pictures are drawn at the end.
"""

import functools
import json
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files import write_json
from ..motion.datasets import hdm05
from . import (
    keypose_alien,
    keypose_dance,
    keypose_recognition,
    keypose_synthetic,
    keypose_tucker,
)
from .keypose_figures import draw_figures
from .keypose_vectors import Vectors, read_vectors
from .stages import Say

# Perera, Kudoh and Ikeuchi, Tables 3 to 5, on their own dances.
PAPER = {
    "known": {"task": 47 / 48, "person": 42 / 48},
    "alien": {"new_task": 22 / 24, "new_person": 20 / 24},
    "task_of_alien_person": 10 / 12,
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
    part = out / "keypose.json.part"
    done = _begun(part, seed)
    if done["stages"]:
        say(f"goes on after {len(done['stages'])} stages in {part}")

    kept = out / "segments.nc.part"

    @functools.cache
    def vectors() -> Vectors:
        root = data / "hdm05" if data is not None else None
        return read_vectors(kept, lambda: hdm05(root=root))

    def chosen() -> dict[str, Any]:
        return done["stages"]["settings"]["chosen"]

    for name, run in _stages(data, vectors, chosen, seed):
        if name in done["stages"]:
            continue
        began = time.perf_counter()
        done["stages"][name] = run()
        done["seconds"][name] = time.perf_counter() - began
        write_json(part, done)
        write_json(out / "keypose.json", without_labels(assembled(done)))
        say(f"{name}: {done['seconds'][name]:.0f} s")
    result = assembled(done)
    draw_figures(result, out)
    result = without_labels(result)
    write_json(out / "keypose.json", result)
    part.unlink()
    kept.unlink(missing_ok=True)
    return result


def assembled(done: Mapping[str, Any]) -> dict[str, Any]:
    """Put what the stages found, all or those there are, into one table of results."""
    stages = done["stages"]
    result: dict[str, Any] = {"paper": PAPER, "seed": done["seed"], "seconds": done["seconds"]}
    for name, found in stages.items():
        kind, *rest = name.split("/")
        if name in ("settings", "dances"):
            result |= {key: dict(value) if name == "dances" else value
                       for key, value in found.items()}  # fmt: skip
        elif not rest:
            result[name] = dict(found)
        else:
            inner = result.setdefault(kind, {})
            for key in rest[:-1]:
                inner = inner.setdefault(key, {})
            inner[rest[-1]] = found
    for name in ("ms_per_probe", "ms_one_probe"):
        if "known" in result:
            result[name] = result["known"].pop(name)
    if "music" in result:
        result.setdefault("beats", {})["music"] = result.pop("music")
    if "alien" in result:
        result["alien"] = {
            kind: keypose_alien.pooled(levels) for kind, levels in result["alien"].items()
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
    yield from keypose_alien.stages(vectors, lambda: chosen()["coefficients"]).items()
    yield "missing_cells", lambda: keypose_tucker.run(vectors().of(**chosen()), seed)
    dances = functools.cache(lambda: keypose_dance.read_dances(data))
    yield "dances", lambda: keypose_dance.run(dances(), seed)
    yield "music", lambda: keypose_dance.music(data, dances(), seed)
    yield "synthetic", lambda: keypose_synthetic.run(seed)


def _begun(part: Path, seed: int) -> dict[str, Any]:
    """Read what a run that was interrupted left behind, or begin anew.

    Raises
    ------
    InputError
        If it had another seed, or the file is no such thing.
    """
    if not part.is_file():
        return {"seed": seed, "seconds": {}, "stages": {}}
    try:
        done = json.loads(part.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(part, f"it cannot be read ({error})", "Delete it") from error
    if done.get("seed") != seed or not {"seconds", "stages"} <= set(done):
        raise InputError(part, f"it is of another run than seed {seed}", "Delete it")
    return done
