"""Small gait-pose models: two gaits of five poses and five features.

gplvm
    Latent points are free on the line, near enough to each other to tell signal from noise.
torus, cylinder
    Latent points near the surface.
on_torus
    On it.
gpdm, ll_gpdm
    Refused.
"""

from collections.abc import Mapping
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from ...gp.linalg import AnyArray
from ...model import SBCCase, Values, draw_sites, logs, shuffled
from ...models.gait_cycles import Cycles, make_cycles, no_topology
from ...models.gait_pose import GaitPose
from ...models.multifactor_identified import pairs
from ...priors.topology import Surface, log_normaliser, topology_of

POSES, GAITS, FEATURES = 5, 2, 5
# Poses whose distances count, two of each gait.
SHOWN = (0, 1, 5, 7)
MODELS = {
    "gplvm": GaitPose("none", latent_size=1, breadth=1.0),
    "torus": GaitPose("torus", sigma=0.5),
    "cylinder": GaitPose("cylinder", sigma=0.5),
    "on_torus": GaitPose("torus", on=True),
    "gpdm": GaitPose("none", dynamics=True),
    "ll_gpdm": GaitPose("circle", dynamics=True),
}


def trial(kind: str) -> tuple[SBCCase, Cycles]:
    """Give the small model of a kind and its data.

    Raises
    ------
    InputError
        If it cannot be drawn from.
    """
    model = MODELS[kind]
    return gait_trial(model), small_cycles(model)


def small_cycles(model: GaitPose) -> Cycles:
    """Give the arrays of the small data set, with zeros for features."""
    y, sizes = np.zeros((GAITS * POSES, FEATURES)), [POSES] * GAITS
    if model.surface == "none":
        start = np.zeros((len(y), model.latent_size))
        return make_cycles(y, start, no_topology(*start.shape), 0.0, sizes, None)
    surface = Surface(model.surface, POSES, GAITS)
    topology = topology_of(surface, within=4)
    constant = log_normaliser(topology, model.sigma, model.breadth)
    return make_cycles(y, surface.points(), topology, constant, sizes, surface)


def gait_trial(model: GaitPose) -> SBCCase:
    """Give the trial of a gait-pose model."""
    return SBCCase(model, _draw, _shuffle, _quantities, "gamma", (("beta", "precision"),))


def _draw(model: GaitPose, key: PRNGKeyArray, data: Cycles) -> tuple[Values, Cycles]:
    values = draw_sites(model, key, data)
    return values, replace(data, y=values.pop("y"))


def _shuffle(key: PRNGKeyArray, data: Cycles) -> Cycles:
    """Put all poses in a random order."""
    return replace(data, y=shuffled(key, data.y, np.zeros(len(data.y), int)))


def _quantities(model: GaitPose, data: Cycles, values: Mapping[str, AnyArray]) -> Values:
    """Give hyperparameters, and sqrt(gamma) times the distances of some poses."""
    out = logs(values, ("variance", "gamma", "beta"))
    x = jnp.asarray(values["x"])[np.array(SHOWN)]
    first, second = pairs(len(SHOWN))
    away = jnp.sqrt(jnp.sum((x[first] - x[second]) ** 2, axis=1))
    return {**out, "distance": jnp.sqrt(values["gamma"]) * away}
