"""Stages of a study: each is done once, and kept in the file of results."""

import hashlib
import json
import subprocess
import time
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ..errors import InputError
from ..files import replacing, write_json
from ..inference.results import versions
from ..netcdf import values_hash

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
        What the file holds: ``settings``, ``made_with`` (the commits it was made at, versions
        of packages, and hashes of the data), ``seconds`` of every stage, and the results.
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
        self.result.setdefault("made_with", {"commits": [], "versions": {}, "data": {}})
        commit()

    def read(self, **data: xr.Dataset | np.ndarray) -> None:
        """Write down the hash of what was read, under the name it has in the results.

        Raises
        ------
        InputError
            If results are there that were made of other data.
        """
        known = self.result["made_with"]["data"]
        for name, values in data.items():
            found = values_hash(values)
            if known.setdefault(name, found) != found:
                raise InputError(
                    self.path, f"its results are of other data ({name})", "Write to another folder"
                )

    def do(self, *keys: str, work: Callable[[], Any]) -> Any:
        """Do a stage unless it is there, under the keys one within the other."""
        place = self.result
        for key in keys[:-1]:
            place = place.setdefault(key, {})
        if keys[-1] not in place:
            began = time.perf_counter()
            place[keys[-1]] = work()
            made_with(self.result)
            seconds = time.perf_counter() - began
            self.result["seconds"][" ".join(keys)] = seconds
            write_json(self.path, self.result)
            self.say(f"{' '.join(keys)}: {seconds:.0f} s")
        return place[keys[-1]]


def made_with(result: dict[str, Any], **data: xr.Dataset | np.ndarray) -> None:
    """Write down in a result what it was made with; a result made in several runs names each."""
    old = result.get("made_with", {"commits": [], "data": {}})
    commits = dict.fromkeys([*old["commits"], commit()])
    hashes = {name: values_hash(values) for name, values in data.items()}
    result["made_with"] = {
        "commits": list(commits),
        "versions": json.loads(versions()),
        "data": old["data"] | hashes,
    }


@cache
def commit() -> str | None:
    """Return the commit of the code, with ``-dirty`` where files were changed; None outside git.

    Asked once, before the first stage: files that change later are not those that run.
    """
    words = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty",
             "--abbrev=40", "--exclude=*"]  # fmt: skip
    try:
        found = subprocess.run(words, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return None
    return found.stdout.strip() if found.returncode == 0 else None


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
