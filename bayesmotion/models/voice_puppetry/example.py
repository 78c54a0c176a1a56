"""Clips of a mouth that goes through three positions, each with a sound of its own."""

import numpy as np
import xarray as xr

FACE = np.array([[-2.0, 0.0], [0.0, 2.0], [2.0, 0.0]])
AUDIO = np.array([[1.5, 0.0, -1.0], [-1.5, 1.0, 0.0], [0.0, -1.5, 1.0]])
STAY = 0.7  # probability; else the next position follows


def three_mouths(seed: int = 0, *, clips: int = 3, frames: int = 20) -> xr.Dataset:
    """Return views ``audio`` and ``face`` (frame, feature) with the coordinate ``clip``.

    Parameters
    ----------
    seed
        Of states and noise.
    clips, frames
        How many clips, and frames of each.
    """
    random = np.random.default_rng(seed)
    steps = random.random((clips, frames)) > STAY
    states = ((np.cumsum(steps, axis=1) + random.integers(3, size=(clips, 1))) % 3).ravel()
    n = clips * frames
    return xr.Dataset(
        {
            "audio": (("frame", "coefficient"), AUDIO[states] + 0.6 * random.normal(size=(n, 3))),
            "face": (("frame", "coordinate"), FACE[states] + 0.5 * random.normal(size=(n, 2))),
        },
        {
            "clip": ("frame", np.repeat([f"clip{i}" for i in range(clips)], frames)),
            "coefficient": ["c0", "c1", "c2"],
            "coordinate": ["open", "wide"],
        },
    )
