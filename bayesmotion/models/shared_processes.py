"""The processes of a shared latent model: of each view, and of the steps of its path.

A view's process is over the shared latent coordinates and, beside them, the view's own; its
equations are in `shared_gplvm`.
"""

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..gp.kernels import Kernel, linear, rbf
from ..gp.linalg import AnyArray
from ..gp.sparse import Explained


class SharedGiven(NamedTuple):
    """A trained model that new clips are seen in the light of.

    values
        Trained sites, ``x`` among them.
    views
        For every view its process conditioned on the training frames.
    steps
        The dynamics conditioned on the training steps, of paths of unit scale; None without.
    middle, scale
        x of unit scale is (x - middle) / scale.
    """

    values: dict[str, AnyArray]
    views: dict[str, Explained]
    steps: Explained | None
    middle: Float[AnyArray, " q"]
    scale: Float[AnyArray, ""]


def view_kernel(name: str, values: Mapping[str, AnyArray]) -> Kernel:
    """Covariance of a feature of a view, of points that `view_points` gives."""
    curved = rbf("x", variance=values[f"{name}_variance"])
    return curved + linear("x", variance=values[f"{name}_linear"])


def view_points(
    name: str,
    values: Mapping[str, AnyArray],
    x: Float[AnyArray, "n q"],
    private: Mapping[str, AnyArray],
) -> dict[str, AnyArray]:
    """Put shared and private coordinates side by side, in the view's lengths."""
    parts = [jnp.asarray(x), *([jnp.asarray(private[name])] if name in private else [])]
    return {"x": jnp.concatenate(parts, axis=1) * jnp.sqrt(values[f"{name}_gamma"])}


def unit_scale(x: Float[AnyArray, "n q"]) -> tuple[Float[Array, " q"], Float[Array, ""]]:
    """Give the mean of latent points and their root mean square about it."""
    x = jnp.asarray(x)
    middle = jnp.mean(x, axis=0)
    return middle, jnp.sqrt(jnp.mean((x - middle) ** 2))


def in_unit_scale(x: AnyArray, middle: AnyArray, scale: AnyArray) -> Float[Array, "n q"]:
    """Bring latent points to unit scale."""
    return (jnp.asarray(x) - middle) / scale
