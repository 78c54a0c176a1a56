"""One function on many draws: compiled once, whatever their number, or a block at a time."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


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
    common = jax.tree.map(jnp.asarray, common)
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
