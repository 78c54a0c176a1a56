"""The draws of a fit as arrays for JAX, and back."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..fit import Fit


def stacked(fit: Fit, most: int | None = None) -> tuple[dict[str, Array], tuple[int, int]]:
    """Give all site values with one leading axis, chain after chain.

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
    posterior = fit.tree["posterior"].to_dataset()
    chains, draws = posterior.sizes["chain"], posterior.sizes["draw"]
    if most is not None and chains * draws > most:
        keep = max(most // chains, 1)
        chosen = np.linspace(0, draws - 1, keep).round().astype(int)
        posterior, draws = posterior.isel(draw=chosen), keep
    values = {}
    for name in posterior.data_vars:
        array = posterior[name].transpose("chain", "draw", ...).values
        values[str(name)] = jnp.asarray(array.reshape(chains * draws, *array.shape[2:]))
    return values, (chains, draws)


def unstacked(values: Array | np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Give an array (S, ...) the dimensions chain and draw again."""
    return np.asarray(values).reshape(*shape, *values.shape[1:])
