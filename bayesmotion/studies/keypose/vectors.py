"""Segments of HDM05 as vectors, made once and kept, for all that the recognition study asks.

Of one array with all channels on one body and one with positions on everyone's own body every
other kind of vectors is a part.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from ...motion.segments import Body, Channels, Segmenting, segments
from ...netcdf import write_netcdf

COEFFICIENTS = 6  # at most


@dataclass(frozen=True)
class Vectors:
    """Segments (clip, channel, coefficient) on one body, with all channels, and on their own."""

    one: xr.DataArray
    own: xr.DataArray

    def of(
        self, channels: Channels, coefficients: int, *, body: Body = "one", static: bool = True
    ) -> xr.DataArray:
        """Give the segments as `Segmenting` with these settings makes them."""
        whole = self.one if body == "one" else self.own
        ends = np.array([len(name.split("/")[1]) for name in whole["channel"].values.tolist()])
        kept = {"positions": ends == 1, "rotations": ends == 2, "both": ends > 0}[channels]
        return whole[:, kept, 0 if static else 1 : coefficients]


def read_vectors(path: Path, motion: Callable[[], xr.Dataset]) -> Vectors:
    """Read the vectors from a file, which is made first where it is not there."""
    if not path.is_file():
        clips = motion()
        made = {
            "one": segments(clips, Segmenting("both", COEFFICIENTS, lengths="file")),
            "own": segments(
                clips, Segmenting("positions", COEFFICIENTS, body="own", lengths="file")
            ),
        }
        tree = xr.DataTree.from_dict({name: xr.Dataset({name: x}) for name, x in made.items()})
        write_netcdf(path, tree)
    with xr.open_datatree(path, engine="h5netcdf") as tree:
        return Vectors(*(tree[name].to_dataset()[name].load() for name in ("one", "own")))
