"""One function on many draws, a block of them at a time: speed of one, memory of the other."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp


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
