"""Where a long run stands, on disk: whole or not at all.

After every block of draws a sampler writes its state and all draws so far. Who kills
the process, at whatever moment, loses one block at most. A checkpoint carries a
fingerprint of data, model and settings, and is not taken up by a run of others.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
from threadpoolctl import threadpool_info

from ..errors import InputError
from ..files import replacing
from ..model import Fittable, ProgramData
from ..npz import read_arrays
from ..registry import describe_model
from ..search_state import SearchState

FINGERPRINT = "fingerprint"


def fingerprint(model: Mapping[str, Any], settings: Mapping[str, Any], data: Any) -> str:
    """Give a hash of a model's description, a run's settings and the arrays it is run on.

    How many threads linear algebra has counts where it is not one: sums are rounded in another
    order, and a run that goes on would not be the one that was left alone.
    """
    threads = max((pool["num_threads"] for pool in threadpool_info()
                   if pool["user_api"] == "blas"), default=1)  # fmt: skip
    if threads > 1:
        settings = {**settings, "threads": threads}
    digest = hashlib.sha256(json.dumps([model, settings], sort_keys=True, default=str).encode())
    leaves, structure = jax.tree.flatten(data)
    digest.update(str(structure).encode())
    for leaf in map(np.ascontiguousarray, leaves):
        digest.update(f"{leaf.dtype}{leaf.shape}".encode())
        digest.update(leaf.tobytes())
    return digest.hexdigest()


def part_of(out: Path) -> Path:
    """Give the name of the checkpoint of a fit that will be saved as `out`."""
    return out.with_name(out.name + ".part")


@dataclass(frozen=True)
class Checkpoint:
    """A file with the state of one run.

    path
        The file; nothing is written where None.
    fingerprint
        Of the run, see `fingerprint`.
    """

    path: Path | None
    fingerprint: str

    @classmethod
    def of(
        cls,
        path: str | Path | None,
        model: Fittable,
        training: ProgramData,
        settings: Mapping[str, Any],
    ) -> "Checkpoint":
        """Return the checkpoint of a run of a model with these settings on training data."""
        told = fingerprint(describe_model(model), settings, training.data)
        return cls(None if path is None else Path(path), told)

    def save(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Write the state; an older one stays until the new one is whole."""
        if self.path is None:
            return
        with replacing(self.path) as temporary, temporary.open("wb") as file:
            named: dict[str, Any] = {FINGERPRINT: np.array(self.fingerprint), **arrays}
            np.savez(file, **named)

    def load(self) -> dict[str, np.ndarray] | None:
        """Read the state; None where there is no file yet.

        Raises
        ------
        InputError
            If the file is none of ours, or of another run.
        """
        if self.path is None or not self.path.exists():
            return None
        arrays = read_arrays(self.path, "a checkpoint", "Delete it, and begin anew")
        if str(arrays.pop(FINGERPRINT, "")) != self.fingerprint:
            raise InputError(
                self.path,
                "it belongs to a run with other data, another model, other settings or another "
                "number of threads",
                "Repeat the options of that run, or delete the file and begin anew",
            )
        return arrays

    def search_state(self, resume: bool) -> SearchState:
        """Return what a model's own search is given: where it stood, and where that is kept."""
        return SearchState(
            None if self.path is None else self.save, self.load() if resume else None
        )

    def remove(self) -> None:
        """Delete the file, once what it led to is saved."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)
