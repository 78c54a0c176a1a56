"""Mixture of probabilistic principal component analysers (Tipping and Bishop 1999).

Each point comes from one of K components; within it, it is a linear map of Q standard
normal numbers, and noise of one variance in all directions:

    k ~ Categorical(pi),    t | k ~ N(mu_k, C_k),    C_k = W_k W_k^T + sigma_k^2 I

The latent numbers and the component are integrated out. W_k counts up to a rotation, and
components up to their order: what the data can tell are the covariances C_k, the density
and the responsibilities

    p(k | t) = pi_k p(t | k) / sum_j pi_j p(t | j)                   (eq. 5 of Sun et al.)

Priors, in units of the points' overall spread s about their mean m:

    pi ~ Dirichlet(1, ..., 1)
    mu_kd ~ N(m_d, (2 s)^2)
    W_kdq ~ N(0, s^2)
    sigma_k^2 ~ LogNormal(log(s^2 / 10), 1.5)

The paper's estimate is the maximum of the likelihood: `mixture_em`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jaxtyping import Float
from numpyro import distributions as dist

from ..errors import InputError
from ..gp.linalg import AnyArray
from .clusters import find_clusters, nearest_centre


class Points(NamedTuple):
    """Points (N, D) with their mean (D,) and overall spread."""

    t: Float[AnyArray, "n d"]
    middle: Float[AnyArray, " d"]
    spread: Float[AnyArray, ""]


@dataclass(frozen=True)
class PointTraining:
    """Points as the model sees them.

    points
        The arrays for the program.
    labels
        Names of the D dimensions.
    """

    points: Points
    labels: tuple[str, ...]

    @property
    def data(self) -> tuple[Points]:
        """The arguments of the model's program."""
        return (self.points,)

    def observed(self) -> xr.Dataset:
        """What the model explains: ``t`` (point, bin)."""
        return xr.Dataset(
            {"t": (("point", "bin"), np.asarray(self.points.t))}, {"bin": list(self.labels)}
        )

    def constants(self) -> xr.Dataset:
        """Mean and spread of the points."""
        return xr.Dataset(
            {
                "middle": ("bin", np.asarray(self.points.middle)),
                "spread": float(self.points.spread),
            },
            {"bin": list(self.labels)},
        )


@dataclass(frozen=True)
class MixturePPCA:
    """The mixture with its settings; see the module for the equations.

    Parameters
    ----------
    components
        K.
    latent
        Q, less than the number of dimensions.

    Raises
    ------
    InputError
        If either is less than 1.
    """

    components: int = 200
    latent: int = 5

    name: ClassVar[str] = "mixture_ppca"

    def __post_init__(self) -> None:
        """Check the settings once."""
        if self.components < 1 or self.latent < 1:
            raise InputError(
                "mixture", f"{self.components} components of {self.latent}", "Give at least 1"
            )

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> "MixturePPCA":
        """Make the model from its settings as plain values."""
        return cls(**settings)

    def prepare(self, data: xr.Dataset) -> PointTraining:
        """Make a data set with ``t`` (point, bin) into arrays.

        Raises
        ------
        InputError
            If it has no such variable, or Q is not less than D.
        """
        if "t" not in data or data["t"].dims != ("point", "bin"):
            raise InputError("points", "there is no t (point, bin)", "Name the variable t")
        t = np.asarray(data["t"].values, dtype=float)
        if self.latent >= t.shape[1]:
            raise InputError(
                "mixture",
                f"{self.latent} latent dimensions for points of {t.shape[1]}",
                "Use fewer",
            )
        middle = t.mean(axis=0)
        points = Points(t, middle, np.sqrt(np.mean((t - middle) ** 2)))
        return PointTraining(points, tuple(map(str, data["bin"].values)))

    def program(self, points: Points) -> None:
        """Generate the points (N, D)."""
        K, Q, D = self.components, self.latent, points.t.shape[1]
        m, s = jnp.asarray(points.middle), points.spread
        pi = numpyro.sample("weight", dist.Dirichlet(jnp.ones(K)))
        mu = numpyro.sample("mean", dist.Normal(m, 2.0 * s).expand([K, D]).to_event(2))
        W = numpyro.sample("factor", dist.Normal(0.0, s).expand([K, D, Q]).to_event(3))
        scale = dist.LogNormal(jnp.log(s**2 / 10.0), 1.5).expand([K]).to_event(1)
        noise = jnp.asarray(numpyro.sample("noise", scale))
        parts = dist.LowRankMultivariateNormal(mu, W, jnp.broadcast_to(noise[:, None], (K, D)))
        mixture = dist.MixtureSameFamily(dist.Categorical(probs=pi), parts)
        with numpyro.plate("point", len(points.t)):
            numpyro.sample("t", mixture, obs=points.t)

    def initial_values(
        self, training: PointTraining, seed: int, count: int
    ) -> list[dict[str, np.ndarray]]:
        """Give starts: clusters of the points, and the main directions within each."""
        return [self._start(training.points, seed + index) for index in range(count)]

    def _start(self, points: Points, seed: int) -> dict[str, np.ndarray]:
        t = np.asarray(points.t)
        clusters = find_clusters(t, self.components, seed=seed)
        nearest = nearest_centre(t, clusters.centre)
        counts = np.bincount(nearest, minlength=self.components) + 1.0
        random = np.random.default_rng(seed)
        small = 0.1 * float(points.spread)
        factor = small * random.standard_normal((*clusters.centre.shape, self.latent))
        noise = np.full(self.components, max(clusters.spread**2 / t.shape[1], small**2))
        return {
            "weight": counts / counts.sum(),
            "mean": clusters.centre,
            "factor": factor,
            "noise": noise,
        }

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Give the dimensions of every site."""
        return {
            # Points last: the likelihood has a part for each of them.
            "t": ("bin", "point"),
            "weight": ("component",),
            "mean": ("component", "bin"),
            "factor": ("component", "bin", "latent"),
            "noise": ("component",),
        }

    def coords(self, training: PointTraining) -> dict[str, list]:
        """Give the labels of every dimension."""
        return {
            "point": list(range(len(training.points.t))),
            "bin": list(training.labels),
            "component": list(range(self.components)),
            "latent": list(range(self.latent)),
        }
