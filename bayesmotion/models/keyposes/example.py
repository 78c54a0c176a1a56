"""Synthetic dances with beats and keyposes, for the example of the keypose model."""

import xarray as xr

from ...motion.joining import concat
from ...motion.synthetic.dance import synthetic_dance
from .data import with_beats, with_keyposes

DANCES, BEATS = 2, 24
NOISE, DRIFT = 0.08, 0.05  # radians, seconds


def example(seed: int) -> xr.Dataset:
    """Make the dances."""
    made = []
    for index in range(DANCES):
        dance = synthetic_dance(DANCES * seed + index, beats=BEATS, noise=NOISE, drift=DRIFT)
        made.append(with_keyposes(with_beats(dance.motion, dance.beats), dance.keyposes.tolist()))
    return concat(made)
