"""The draws of a fit as arrays for JAX and back, and functions of every draw."""

import zlib
from collections.abc import Callable, Mapping
from typing import Any

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
        values[str(name)] = array.reshape(chains * draws, *array.shape[2:])
    return on_device(values), (chains, draws)


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


def on_device(arrays: Any) -> Any:
    """Return a pytree of NumPy arrays as JAX's.

    `jnp.asarray` would compile a program for every shape that it has not met.
    """
    return jax.device_put(arrays)


def unstacked(values: Array | np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return an array (S, ...) with the dimensions chain and draw again."""
    return np.asarray(values).reshape(*shape, *values.shape[1:])


def one_by_one(function: Callable[..., Any], draws: Any, *common: Any) -> Any:
    """Call a compiled function on one draw after the other.

    Parameters
    ----------
    function
        Compiled, of a draw and what is common to all.
    draws
        A pytree of arrays (S, ...), random keys among them.
    common
        Further arguments.

    Returns
    -------
    What it returns, NumPy arrays (S, ...). As the compiled program knows nothing of S, fits by
    MAP and by any number of draws share it.
    """
    leaves, structure = jax.tree.flatten(draws)
    columns = [list(_readable(leaf)) for leaf in leaves]
    common = on_device(common)
    found = [
        jax.device_get(function(jax.tree.unflatten(structure, row), *common))
        for row in zip(*columns, strict=True)
    ]
    return jax.tree.map(lambda *parts: np.stack(parts), *found)


def _readable(leaf: Any) -> Any:
    """Return an array that is taken apart without compiling; keys of random numbers as they are."""
    is_key = isinstance(leaf, jax.Array) and jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
    return leaf if is_key else np.asarray(leaf)


def in_blocks(function: Callable[[Any], Any], arguments: Any, size: int) -> Any:
    """Call `function` on every entry of the leading axis of `arguments`, `size` at a time.

    As `jax.lax.map` with a batch size, but entries may be arrays without elements (a
    site of a model may have none), and the last block is filled up.
    """
    count = len(jax.tree.leaves(arguments)[0])
    size = min(size, count)
    blocks = -(-count // size)
    filled = jnp.minimum(jnp.arange(blocks * size), count - 1)

    def split(leaf):
        leaf = jnp.asarray(leaf)
        return leaf[filled].reshape(blocks, size, *leaf.shape[1:])

    found = jax.lax.map(jax.vmap(function), jax.tree.map(split, arguments))
    return jax.tree.map(lambda a: a.reshape(blocks * size, *a.shape[2:])[:count], found)
