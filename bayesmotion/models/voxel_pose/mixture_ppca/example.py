"""Points of two clusters for `MixturePPCA.example`."""

import numpy as np
import xarray as xr

COUNT, BINS = 60, ("a", "b", "c", "d")


def example(seed: int) -> xr.Dataset:
    """Return points (point, bin) of two clusters far apart, each long in one direction.

    One entry in twenty is missing.
    """
    random = np.random.default_rng(seed)
    centre = np.array([[-4.0, 0.0, 2.0, 1.0], [4.0, 3.0, 0.0, -2.0]])
    direction = np.array([[1.0, 0.5, 0.0, 0.5], [0.0, 1.0, -0.5, 0.5]])
    k = np.arange(COUNT) % 2
    t = centre[k] + direction[k] * random.standard_normal((COUNT, 1))
    t += 0.3 * random.standard_normal(t.shape)
    t[random.random(t.shape) < 0.05] = np.nan
    t[np.isnan(t).all(axis=1)] = centre[0]
    return xr.Dataset({"t": (("point", "bin"), t)}, {"point": range(COUNT), "bin": list(BINS)})
