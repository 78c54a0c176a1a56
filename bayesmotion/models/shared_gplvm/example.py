"""Two views of a point that goes round unevenly, as sound and face of one mouth would be."""

import xarray as xr

from ...motion.synthetic.talk import synthetic_talk


def talk(seed: int = 0) -> xr.Dataset:
    """Return two clips of twelve frames, four features of sound and three of the face."""
    return synthetic_talk(seed, clips=2, frames=12)
