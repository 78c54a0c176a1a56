"""Gait cycles of synthetic people, few enough to be fitted within seconds."""

import xarray as xr

from ...motion.cycles import cycles_of
from ...motion.synthetic.walkers import synthetic_walkers

PEOPLE, POSES = ("ann", "ben", "cas"), 6


def example_cycles(seed: int) -> xr.Dataset:
    """Return a cycle of each of three people."""
    walks = synthetic_walkers(PEOPLE, ("walk",), seconds=2.6, styles=2, seed=seed)
    return cycles_of(walks, 1, poses=POSES)
