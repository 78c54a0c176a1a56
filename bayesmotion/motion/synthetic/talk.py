"""Sound and face features of a mouth that opens and closes unevenly: data made by formula.

The mouth's state is a point that goes round a circle; four features of sound are saturating
functions of it, three of the face are smooth ones, and both have noise.
"""

import numpy as np
import xarray as xr

AUDIO = np.array([[1.0, -0.5, 0.3, 0.8], [0.4, 1.0, -0.9, 0.1]])
SPEED, UNEVEN = 0.3, 0.1  # radians a frame
AUDIO_NOISE, FACE_NOISE = 0.05, 0.3


def synthetic_talk(seed: int = 0, *, clips: int = 2, frames: int = 12) -> xr.Dataset:
    """Return views ``audio`` and ``face`` (frame, feature) with the coordinate ``clip``.

    Parameters
    ----------
    seed
        Of speeds and noise.
    clips, frames
        How many clips, and frames of each.
    """
    random = np.random.default_rng(seed)
    points = []
    for _ in range(clips):
        steps = SPEED + UNEVEN * random.normal(size=frames)
        angle = random.uniform(0, 2.0 * np.pi) + np.cumsum(steps)
        points.append(np.column_stack([np.cos(angle), np.sin(angle)]))
    x = np.concatenate(points)
    face = 10.0 * np.column_stack([x, x[:, 0] * x[:, 1]])
    audio = np.tanh(x @ AUDIO) + AUDIO_NOISE * random.normal(size=(len(x), 4))
    return xr.Dataset(
        {
            "audio": (("frame", "coefficient"), audio),
            "face": (("frame", "coordinate"), face + FACE_NOISE * random.normal(size=face.shape)),
        },
        {
            "clip": ("frame", np.repeat([f"clip{i}" for i in range(clips)], frames)),
            "coefficient": ["c0", "c1", "c2", "c3"],
            "coordinate": ["x", "y", "z"],
        },
    )
