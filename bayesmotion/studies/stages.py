"""Stages of a study: each is done once, and kept in the file of results."""

import hashlib
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files import replacing, write_json

Say = Callable[[str], None]


class Stages:
    """What of the result is there already, and the file it is written to.

    Results of other settings are done again. The file is written after every stage, so a
    run that is interrupted loses the stage it was at and no more.

    Parameters
    ----------
    path
        The file of results.
    settings
        All that what is kept depends on, as JSON can hold it.
    say
        Called with a line after every stage.

    Raises
    ------
    InputError
        If the file is there and cannot be read.

    Attributes
    ----------
    result
        What the file holds: ``settings``, ``seconds`` of every stage, and the results.
    folder
        Beside the file, named by the settings: fits and whatever else is kept for them. A
        study keeps nothing elsewhere that it reads again, so that nothing of other settings is
        ever taken for its own.
    """

    def __init__(self, path: Path, settings: dict[str, Any], say: Say) -> None:
        self.path, self.say = path, say
        text = json.dumps(settings)
        settings = json.loads(text)
        name = hashlib.sha256(text.encode()).hexdigest()[:8]
        self.folder = path.parent / f"{path.stem}-{name}"
        self.result: dict[str, Any] = {"settings": settings, "seconds": {}}
        if path.is_file():
            try:
                old = json.loads(path.read_text(encoding="utf-8"))
            except ValueError as error:
                raise InputError(path, f"it cannot be read ({error})", "Delete it") from error
            if old.get("settings") == settings:
                self.result = old

    def do(self, *keys: str, work: Callable[[], Any]) -> Any:
        """Do a stage unless it is there, under the keys one within the other."""
        place = self.result
        for key in keys[:-1]:
            place = place.setdefault(key, {})
        if keys[-1] not in place:
            began = time.perf_counter()
            place[keys[-1]] = work()
            seconds = time.perf_counter() - began
            self.result["seconds"][" ".join(keys)] = seconds
            write_json(self.path, self.result)
            self.say(f"{' '.join(keys)}: {seconds:.0f} s")
        return place[keys[-1]]


def kept_arrays(
    path: Path, make: Callable[[], Mapping[str, np.ndarray | float]]
) -> dict[str, np.ndarray]:
    """Read arrays from a file, which is made first where it is not there."""
    if not path.is_file():
        arrays = make()
        with replacing(path) as temporary:
            np.savez(temporary, allow_pickle=False, **arrays)
    with np.load(path) as stored:
        return {name: stored[name] for name in stored.files}
