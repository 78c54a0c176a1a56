"""What all poses share: the kernel's parameters and the noise, and their priors.

variance ~ LogNormal(0, 1)            features have a mean square of one
gamma    ~ LogNormal(0, 1)            the middle layer has radius one
beta     ~ LogNormal(log 100, 1)      precision of the noise
alpha    ~ LogNormal(log medians, 1)  of the dynamics, see `distributions.dynamics`
"""

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
import numpyro
from jaxtyping import Array, Float
from numpyro import distributions as dist

from ...gp.kernels import Kernel, rbf
from ...gp.linalg import AnyArray

NAMES = ("variance", "gamma", "beta")
INITIAL = {"variance": 1.0, "gamma": 1.0, "beta": 100.0}
ALPHA_MEDIAN = (0.1, 1.0, 1.0)
ALPHA_PARTS = ["variance", "gamma", "linear_variance"]


def priors() -> dict[str, dist.Distribution]:
    """Return the prior of each of `NAMES`."""
    return {
        "variance": dist.LogNormal(0.0, 1.0),
        "gamma": dist.LogNormal(0.0, 1.0),
        "beta": dist.LogNormal(jnp.log(100.0), 1.0),
    }


def sample_hyperparameters() -> dict[str, AnyArray]:
    """Sample what all poses share."""
    return {name: jnp.asarray(numpyro.sample(name, prior)) for name, prior in priors().items()}


def log_prior(hyper: Mapping[str, AnyArray]) -> Float[Array, ""]:
    """Return the log density of what all poses share."""
    parts = [prior.log_prob(hyper[name]) for name, prior in priors().items()]
    return jnp.sum(jnp.stack([jnp.asarray(part) for part in parts]))


def alpha_prior() -> dist.Distribution:
    """Return the prior of the dynamics' hyperparameters but for their noise."""
    return dist.LogNormal(jnp.log(jnp.asarray(ALPHA_MEDIAN)), 1.0).to_event(1)


def pose_kernel(hyper: Mapping[str, AnyArray]) -> Kernel:
    """Return the covariance of one feature without the noise, on the factor ``x``."""
    return rbf("x", length_scale=hyper["gamma"] ** -0.5, variance=hyper["variance"])


def covariance(hyper: Mapping[str, AnyArray], x: Float[AnyArray, "n q"]) -> Float[Array, "n n"]:
    """Return the covariance of one feature of training poses at latent points, noise included."""
    points = {"x": x}
    return pose_kernel(hyper).matrix(points, points) + jnp.eye(x.shape[0]) / hyper["beta"]


def initial() -> dict[str, np.ndarray]:
    """Return values of `NAMES` to begin from."""
    return {name: np.array(value) for name, value in INITIAL.items()}
