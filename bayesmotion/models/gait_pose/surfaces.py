"""Where the latent points of cycles lie: along a surface, around it, or on it.

The priors are those of `program`; the surfaces are `distributions.topology`'s.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
from jaxtyping import Float
from numpyro import distributions as dist

from ...distributions.topology import Surface, Topology, open_path, topology_of, tour
from ...gp.linalg import AnyArray
from .settings import LatentSpace, NoSurface, OnSurface, PoseCircle


class LatentStart(NamedTuple):
    """Where the latent points of training cycles begin.

    surface
        The ideal surface, None without one.
    topology
        Its neighbours and weights, None where points are not drawn to them.
    x
        (N, Q).
    """

    surface: Surface | None
    topology: Topology | None
    x: Float[np.ndarray, "n q"]


def order_along(surface: LatentSpace, distances: Float[np.ndarray, "g g"]) -> list[int]:
    """Order gaits along a surface by how far they are from each other."""
    if isinstance(surface, NoSurface | PoseCircle):
        return list(range(len(distances)))
    return tour(distances) if surface.shape == "torus" else open_path(distances)


def latent_start(
    kind: LatentSpace,
    y: Float[np.ndarray, "n d"],
    poses: int,
    gaits: int,
    scales: tuple[float, ...],
    within: int | None = None,
) -> LatentStart:
    """Return the surface, its topology, and where the latent points begin.

    Parameters
    ----------
    kind
        Of the surface.
    y
        (N, D) features of `poses` poses of `gaits` gaits at every one of the `scales`.
    within
        Neighbours in a point's own layer, of surfaces too small for the usual number.
    """
    if isinstance(kind, NoSurface):
        return LatentStart(None, None, _components(y, kind.latent_size))
    surface = Surface(kind.shape, poses, gaits, scales)
    x = surface.points()
    if isinstance(kind, PoseCircle):
        # Nothing orders gaits but how they differ most.
        cycles = y.reshape(len(scales) * gaits, poses, -1)
        seen = np.isfinite(cycles)
        sums = np.where(seen, cycles, 0.0).sum(axis=1)
        means = sums / np.maximum(seen.sum(axis=1), 1)
        x[:, 1] = np.repeat(_components(means, 1)[:, 0], poses)
    if isinstance(kind, OnSurface):
        return LatentStart(surface, None, x)
    few = {} if within is None else {"within": within, "across": within}
    return LatentStart(surface, topology_of(surface, **few), x)


def coordinates(
    surface: Surface, spread: float, random: np.random.Generator
) -> dict[str, np.ndarray]:
    """Return coordinates of the ideal surface, or some around them."""
    gaits, layers = surface.gaits, len(surface.radii)
    return {
        "phase": spread * random.normal(size=gaits * layers),
        "gait": np.arange(gaits) + spread * random.normal(size=gaits),
        "radius": np.array(surface.radii) * np.exp(spread * random.normal(size=layers)),
    }


def sample_on_surface(surface: Surface, priors: OnSurface) -> Float[AnyArray, "n 3"]:
    """Sample where cycles lie on the surface, and return the points of their poses."""
    gaits, layers = surface.gaits, len(surface.radii)
    layer, gait, pose = surface.index().T
    ahead = dist.Normal(0.0, priors.phase_sd).expand([gaits * layers]).to_event(1)
    phase = numpyro.sample("phase", ahead)
    at = dist.Normal(jnp.arange(gaits), priors.gait_sd).to_event(1)
    along = numpyro.sample("gait", at)
    medians = jnp.log(jnp.asarray(surface.radii))
    radius = numpyro.sample("radius", dist.LogNormal(medians, priors.radius_sd).to_event(1))
    shift = jnp.asarray(phase)[layer * gaits + gait]
    return surface.at(pose + shift, jnp.asarray(along)[gait], jnp.asarray(radius)[layer])


def _components(y: Float[np.ndarray, "n d"], count: int) -> Float[np.ndarray, "n q"]:
    """Return principal components, each of the mean square of its share, together of one."""
    centred = np.nan_to_num(y - np.nanmean(y, axis=0))
    u, s, _ = np.linalg.svd(centred, full_matrices=False)
    scores = u[:, :count] * s[:count]
    return scores / np.sqrt(max(np.mean(scores**2), np.finfo(float).tiny))
