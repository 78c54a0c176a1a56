"""The draws of a fit as arrays for JAX, some of them, and back."""

import zlib
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Array, Key

from ..fit import Fit


def stacked(fit: Fit, most: int | None = None) -> tuple[dict[str, Array], tuple[int, int]]:
    """Return all site values with one leading axis, chain after chain.

    Parameters
    ----------
    fit
        Any fit.
    most
        At most so many draws of all chains together, evenly spread; all where None.

    Returns
    -------
    The values (S, ...) and the numbers of chains and of draws in each.
    """
    posterior = thinned(fit, most)
    chains, draws = posterior.sizes["chain"], posterior.sizes["draw"]
    values = {}
    for name in posterior.data_vars:
        array = posterior[name].transpose("chain", "draw", ...).values
        values[str(name)] = jnp.asarray(array.reshape(chains * draws, *array.shape[2:]))
    return values, (chains, draws)


def thinned(fit: Fit, most: int | None = None) -> xr.Dataset:
    """Return the posterior, of every chain the same draws, at most so many of all together.

    They are those in the middle of equal parts of the chain: the same read forwards and back.
    So they are an even number of every chain, of twenty draws of four chains sixteen, and two
    of every chain at least.
    """
    posterior = fit.tree["posterior"].to_dataset()
    chains, draws = posterior.sizes["chain"], posterior.sizes["draw"]
    if most is None or chains * draws <= most:
        return posterior
    # An odd number has no such middle where the chain's length is even.
    keep = max(most // chains // 2 * 2, 1)
    half = ((np.arange((keep + 1) // 2) + 0.5) * draws / keep).astype(int)
    chosen = np.unique(np.concatenate([half, draws - 1 - half]))
    return posterior.isel(draw=chosen)


def draw_keys(seed: int, values: Mapping[str, Array]) -> Key[Array, " s"]:
    """Return a random key for every draw (S, ...), by what is drawn and not by its place.

    So what is said with them does not depend on the order of the draws.
    """
    names = sorted(values)
    count = len(values[names[0]])
    codes = np.zeros(count, np.uint32)
    arrays = [np.ascontiguousarray(values[name]) for name in names]
    for index in range(count):
        code = 0
        for array in arrays:
            code = zlib.crc32(array[index].tobytes(), code)
        codes[index] = code
    return jax.vmap(lambda code: jax.random.fold_in(jax.random.key(seed), code))(codes)


def unstacked(values: Array | np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return an array (S, ...) with the dimensions chain and draw again."""
    return np.asarray(values).reshape(*shape, *values.shape[1:])
