"""Where the latent points of cycles lie: along a surface, around it, or on it.

The priors are those of `gait_pose`; the surfaces are `priors.topology`'s.
"""

from typing import Literal

import jax.numpy as jnp
import numpy as np
import numpyro
from jaxtyping import Float
from numpyro import distributions as dist

from ..gp.linalg import AnyArray
from ..priors.topology import Surface, Topology, open_path, topology_of, tour
from .gait_cycles import Cycles, GaitTraining, no_topology

Kind = Literal["torus", "cylinder", "circle", "none"]


def order_along(surface: Kind, distances: Float[np.ndarray, "g g"]) -> list[int]:
    """Order gaits along a surface by how far they are from each other."""
    if surface == "torus":
        return tour(distances)
    return open_path(distances) if surface == "cylinder" else list(range(len(distances)))


def beginning(
    kind: Kind,
    y: Float[np.ndarray, "n d"],
    poses: int,
    gaits: int,
    scales: tuple[float, ...],
    latent_size: int,
) -> tuple[Surface | None, Topology, Float[np.ndarray, "n q"]]:
    """Give the surface, its topology, and where the latent points begin.

    Parameters
    ----------
    kind
        Of the surface.
    y
        (N, D) features of `poses` poses of `gaits` gaits at every one of the `scales`.
    latent_size
        Q without a surface.
    """
    if kind == "none":
        start = _components(y, latent_size)
        return None, no_topology(*start.shape), start
    surface = Surface(kind, poses, gaits, scales)
    start = surface.points()
    if kind == "circle":
        # Nothing orders gaits but how they differ most.
        means = y.reshape(len(scales) * gaits, poses, -1).mean(axis=1)
        start[:, 1] = np.repeat(_components(means, 1)[:, 0], poses)
    return surface, topology_of(surface), start


def coordinates(
    training: GaitTraining, spread: float, random: np.random.Generator
) -> dict[str, np.ndarray]:
    """Give coordinates of the ideal surface, or some around them."""
    surface = training.surface
    assert surface is not None
    gaits, layers = surface.gaits, len(surface.radii)
    return {
        "phase": spread * random.normal(size=gaits * layers),
        "gait": np.arange(gaits) + spread * random.normal(size=gaits),
        "radius": np.array(surface.radii) * np.exp(spread * random.normal(size=layers)),
    }


def on_surface(cycles: Cycles) -> Float[AnyArray, "n 3"]:
    """Sample where cycles lie on the surface, and give the points of their poses."""
    surface = cycles.surface
    assert surface is not None
    gaits, layers = surface.gaits, len(surface.radii)
    layer, gait, pose = surface.index().T
    phase = numpyro.sample("phase", dist.Normal().expand([gaits * layers]).to_event(1))
    along = numpyro.sample("gait", dist.Normal(jnp.arange(gaits), 1.0).to_event(1))
    medians = jnp.log(jnp.asarray(surface.radii))
    radius = numpyro.sample("radius", dist.LogNormal(medians, 0.2).to_event(1))
    shift = jnp.asarray(phase)[layer * gaits + gait]
    return surface.at(pose + shift, jnp.asarray(along)[gait], jnp.asarray(radius)[layer])


def _components(y: Float[np.ndarray, "n d"], count: int) -> Float[np.ndarray, "n q"]:
    """Principal components, each of the mean square of its share, together of one."""
    centred = np.nan_to_num(y - np.nanmean(y, axis=0))
    u, s, _ = np.linalg.svd(centred, full_matrices=False)
    scores = u[:, :count] * s[:count]
    return scores / np.sqrt(np.mean(scores**2))
