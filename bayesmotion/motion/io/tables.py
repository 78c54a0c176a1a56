"""What tasks say, with its uncertainty, as files: netCDF, or a long table of csv.

A table is a data set of ``mean`` and ``sd`` (frame, channel) and ``quantiles`` (quantile,
frame, channel), with the coordinates ``clip`` and ``time`` (s) of frames and ``unit`` of
channels. As csv it has one line a frame and channel:

    clip, time_s, channel, unit, mean, sd, q05, q25, q50, q75, q95
"""

from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np
import pandas as pd
import xarray as xr

from ...errors import InputError
from ...files import TABLE, replacing
from ...netcdf import write_netcdf


@runtime_checkable
class Tabular(Protocol):
    """Anything with a table of this kind."""

    def to_dataset(self) -> xr.Dataset:
        """Return mean, sd and quantiles by time and channel."""
        ...


def write_table(table: xr.Dataset, path: Path) -> None:
    """Write a table, going by the suffix: .nc or .csv; an older file stays until it is whole.

    Raises
    ------
    InputError
        If the suffix is another, or there is a file that holds no such table.
    """
    suffix = path.suffix.lower()
    if suffix not in TABLE.suffixes:
        raise InputError(
            path, f"means and quantiles are not written as {suffix or 'nothing'!r}",
            "Use .csv or .nc; a motion alone is written as .bvh",
        )  # fmt: skip
    TABLE.check(path)
    if suffix == ".nc":
        write_netcdf(path, table)
        return
    with replacing(path) as temporary:
        long_table(table).to_csv(temporary, index=False, float_format="%.6g")


def long_table(table: xr.Dataset) -> pd.DataFrame:
    """Return a table with one row a frame and channel."""
    frames, channels = table["mean"].shape

    def of_frame(name: str) -> np.ndarray:
        return np.repeat(table[name].values, channels)

    def of_channel(name: str) -> np.ndarray:
        return np.tile(table[name].values, frames)

    columns: dict[str, np.ndarray] = {
        "clip": of_frame("clip"),
        "time_s": of_frame("time"),
        "channel": of_channel("channel"),
        "unit": of_channel("unit"),
        "mean": table["mean"].values.ravel(),
        "sd": table["sd"].values.ravel(),
    }
    for number, probability in enumerate(table["quantile"].values.tolist()):
        columns[f"q{100 * probability:02.0f}"] = table["quantiles"].values[number].ravel()
    return pd.DataFrame(columns)
