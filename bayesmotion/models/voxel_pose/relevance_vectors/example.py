"""Two curves for `RelevanceVectors.example`."""

import numpy as np
import xarray as xr

COUNT = 20


def example(seed: int) -> xr.Dataset:
    """Return noisy values of sin(x) / x and cos(x); one in twenty is missing."""
    random = np.random.default_rng(seed)
    x = np.sort(random.uniform(-5, 5, COUNT))
    y = np.column_stack([np.sinc(x / np.pi), np.cos(x)])
    y += 0.1 * random.standard_normal(y.shape)
    y[random.random(y.shape) < 0.05] = np.nan
    return xr.Dataset(
        {"x": (("frame", "feature"), x[:, None]), "y": (("frame", "output"), y)},
        {"frame": range(COUNT), "output": ["sinc", "cos"]},
    )
