"""Real speech with articulators: sound and the positions of seven sensors, and its splits.

Sensors are on the lips and the tongue of one speaker of Mandarin, in mm at 250 a second
(electromagnetic articulography). A frame of a 25th of a second has the mean of its ten
positions, and the cepstra of the sound around the same middle.
"""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.io import loadmat

from ...errors import InputError
from ...sensing.audio.cepstra import mfcc, read_audio
from ...sensing.face.views import FRAME_RATE, views_of
from .models import COEFFICIENTS

SENSORS = (
    "upper lip", "lower lip", "left corner", "right corner", "tongue root", "tongue middle",
    "tongue tip",
)  # fmt: skip
COORDINATES = tuple(f"{sensor} {axis}" for sensor in SENSORS for axis in "xyz")
LIPS = slice(0, 12)
PER_FRAME = 10  # positions
TRAINING, TEST = 40, 12


@dataclass(frozen=True)
class Utterances:
    """Sound features (T, 20) and faces (T, 21) in mm, by utterance."""

    sound: dict[str, Float[np.ndarray, "_ a"]]
    face: dict[str, Float[np.ndarray, "_ d"]]

    @property
    def count(self) -> int:
        """Number of utterances."""
        return len(self.sound)

    @property
    def frames(self) -> int:
        """Frames of all utterances."""
        return sum(map(len, self.sound.values()))

    def split(self, repeat: int, seed: int) -> tuple[list[str], list[str]]:
        """Give the training and the test utterances of a repeat, drawn at random."""
        names = sorted(self.sound)
        order = np.random.default_rng(seed + repeat).permutation(len(names))
        drawn = [names[i] for i in order[: TRAINING + TEST]]
        return drawn[:TRAINING], drawn[TRAINING:]

    def views(self, names: list[str], coefficients: int) -> xr.Dataset:
        """Give some utterances as views."""
        sound = {name: self.sound[name][:, :coefficients] for name in names}
        return views_of(sound, {name: self.face[name] for name in names}, COORDINATES)


def read_utterances(data: Path | None) -> Utterances:
    """Read all utterances from ``speech_ema/`` in `data`, by default in BAYESMOTION_DATA.

    Raises
    ------
    InputError
        If the folder is not there or holds too few.
    """
    folder = Path(data or os.environ.get("BAYESMOTION_DATA", "")) / "speech_ema"
    paths = sorted(folder.glob("*.wav"))
    if len(paths) < TRAINING + TEST:
        raise InputError(
            folder,
            f"it holds {len(paths)} utterances",
            "Give the folder of the recordings (--data)",
        )
    sound, face = {}, {}
    for path in paths:
        wave, rate = read_audio(path)
        heard = mfcc(wave, rate, FRAME_RATE, COEFFICIENTS)
        positions = _positions(path.with_suffix(".mat"))
        frames = min(len(positions) // PER_FRAME, len(heard))
        whole = positions[: frames * PER_FRAME].reshape(frames, PER_FRAME, -1)
        sound[path.stem], face[path.stem] = heard[:frames], whole.mean(axis=1)
    return Utterances(sound, face)


def _positions(path: Path) -> Float[np.ndarray, "n d"]:
    """Give the three coordinates of every sensor; two angles and a residual follow them."""
    found = np.asarray(loadmat(path)[path.stem], dtype=float)
    return found.reshape(len(found), len(SENSORS), 6)[:, :, :3].reshape(len(found), -1)
