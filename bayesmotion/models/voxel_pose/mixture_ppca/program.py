"""Mixture of probabilistic principal component analysers (Tipping and Bishop 1999).

Each point comes from one of K components; within it, it is a linear map of Q standard
normal numbers, and noise of one variance in all directions:

    k ~ Categorical(pi),    t | k ~ N(mu_k, C_k),    C_k = W_k W_k^T + sigma_k^2 I

The latent numbers, the component and missing bins are integrated out (`density`). W_k
counts up to a rotation, and components up to their order: identified are the density, the
responsibilities

    p(k | t) = pi_k p(t | k) / sum_j pi_j p(t | j)                   (eq. 5 of Sun et al.)

and what is the same in any order of the components. Priors, in units of the points'
overall standard deviation s about their mean m:

    pi ~ Dirichlet(1, ..., 1)
    mu_kd ~ N(m_d, (2 s)^2)
    W_kdq ~ N(0, s^2)
    sigma_k^2 ~ LogNormal(log(s^2 / 10), 1.5)

The paper's estimate is the maximum of the likelihood, by `em`: with many points that of the
program.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
import numpyro
import xarray as xr
from jax.scipy.special import logsumexp
from jaxtyping import Array, Float
from numpyro import distributions as dist

from ....errors import InputError
from ....gp.linalg import AnyArray
from ....model import About, PointEstimate, Progress, SBCCase, Values
from ....search_state import SearchState
from ...clusters import find_clusters, nearest_centre
from . import sbc
from .data import PointData, Points, prepare_points
from .density import Mixture, PPCAMixture, PPCAPredictive, latent
from .em import completed, fit_mixture
from .example import example

# Training points at which the density is among what is identified, at most.
LANDMARKS = 20


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
    about: ClassVar[About] = About(
        "Tipping and Bishop 1999; Sun et al. 2006",
        "points t (point, bin), such as shape contexts",
        ("em", "map", "nuts", "ensemble"),
    )

    def __post_init__(self) -> None:
        """Check the settings once."""
        if self.components < 1 or self.latent < 1:
            raise InputError(
                "mixture", f"{self.components} components of {self.latent}", "Give at least 1"
            )

    @classmethod
    def example(cls, seed: int = 0) -> tuple["MixturePPCA", xr.Dataset]:
        """Return a mixture of two components and points of two clusters, some bins missing."""
        return cls(components=2, latent=1), example(seed)

    def prepare(self, recordings: xr.Dataset, trained: PointData | None = None) -> PointData:
        """Make a data set with ``t`` (point, bin) into arrays.

        Raises
        ------
        InputError
            If it has no such variable, Q is not less than D, or bins are others than trained.
        """
        data = prepare_points(recordings, trained)
        if self.latent >= len(data.labels):
            raise InputError(
                "mixture",
                f"{self.latent} latent dimensions for points of {len(data.labels)}",
                "Use fewer",
            )
        return data

    def program(self, points: Points, trained: Mixture | None = None) -> None:
        """Sample the points (N, D)."""
        mixture = self.sample_mixture(points) if trained is None else trained
        with numpyro.plate("point", len(points.t)):
            numpyro.sample("t", PPCAMixture(mixture, len(points.t)), obs=points.t)

    def sample_mixture(self, points: Points) -> Mixture:
        """Sample the parameters from their priors."""
        K, Q, D = self.components, self.latent, points.location.shape[0]
        m, s = jnp.asarray(points.location), points.scale
        pi = numpyro.sample("weight", dist.Dirichlet(jnp.ones(K)))
        mu = numpyro.sample("mean", dist.Normal(m, 2.0 * s).expand([K, D]).to_event(2))
        W = numpyro.sample("factor", dist.Normal(0.0, s).expand([K, D, Q]).to_event(3))
        scale = dist.LogNormal(jnp.log(s**2 / 10.0), 1.5).expand([K]).to_event(1)
        noise = numpyro.sample("noise", scale)
        return Mixture(*map(jnp.asarray, (pi, mu, W, noise)))

    def initial_values(
        self, data: PointData, seed: int, count: int, trained: Mixture | None = None
    ) -> list[dict[str, np.ndarray]]:
        """Return clusters of the points, each spread in random directions; nothing of new data."""
        if trained is not None:
            return [{} for _ in range(count)]
        return [self.initial(data.points, seed + index) for index in range(count)]

    def initial(self, points: Points, seed: int) -> dict[str, np.ndarray]:
        """Return values of the parameters to begin from."""
        t = completed(np.asarray(points.t), np.asarray(points.location))
        clusters = find_clusters(t, self.components, seed=seed)
        nearest = nearest_centre(t, clusters.centre)
        counts = np.bincount(nearest, minlength=self.components) + 1.0
        random = np.random.default_rng(seed)
        small = 0.1 * float(points.scale)
        factor = small * random.standard_normal((*clusters.centre.shape, self.latent))
        noise = np.full(self.components, max(clusters.sd**2 / t.shape[1], small**2))
        return {
            "weight": counts / counts.sum(),
            "mean": clusters.centre,
            "factor": factor,
            "noise": noise,
        }

    def em(
        self,
        data: PointData,
        *,
        seed: int,
        max_steps: int,
        tolerance: float,
        progress: Progress | None = None,
        state: SearchState | None = None,
    ) -> PointEstimate:
        """Fit by expectation and maximisation of the likelihood, from k-means.

        Parameters
        ----------
        data
            Training points.
        seed
            Of k-means.
        max_steps
            At most so many steps.
        tolerance
            Gain of log likelihood, relative to its size, below which a step is the last.
        progress
            Called with the steps done and the log likelihood a point.
        state
            Where an earlier search stood, and where this one is kept.
        """
        found = fit_mixture(
            np.asarray(data.points.t),
            self.components,
            self.latent,
            seed=seed,
            max_steps=max_steps,
            tolerance=tolerance,
            progress=progress,
            state=state,
        )
        return PointEstimate(
            found.mixture._asdict(),
            float(found.log_likelihood[-1]),
            len(found.log_likelihood) - 1,
            found.converged,
        )

    def condition(self, points: Points, values: Mapping[str, AnyArray]) -> Mixture:
        """Return the parameters of one draw."""
        return Mixture(*(jnp.asarray(values[name]) for name in Mixture._fields))

    def predict(
        self, trained: Mixture, points: Points, values: Mapping[str, AnyArray]
    ) -> dict[str, PPCAPredictive]:
        """Predict every bin of points given those of it that are seen."""
        return {"t": PPCAPredictive.of(trained, points.t)}

    def identified(self, points: Points, values: Mapping[str, AnyArray]) -> Values:
        """Return what is the same in any order of components and under rotations of W_k.

        The log likelihood, mean and covariance of the whole mixture, its weights and noises in
        order, and the log density at some training points.
        """
        mixture = self.condition(points, values)
        density = self.pointwise(points, values)
        mean = mixture.weight @ mixture.mean
        apart = mixture.mean - mean
        within = jnp.einsum("k,kde->de", mixture.weight, mixture.covariances())
        between = jnp.einsum("k,kd,ke->de", mixture.weight, apart, apart)
        return {
            "log_likelihood": density.sum(),
            "overall_mean": jnp.asarray(mean),
            "overall_covariance": within + between,
            "sorted_weight": jnp.sort(mixture.weight),
            "sorted_noise": jnp.sort(mixture.noise),
            "log_density": density[landmarks(len(points.t))],
        }

    def pointwise(self, points: Points, values: Mapping[str, AnyArray]) -> Float[Array, " n"]:
        """Return the log density of every point: they are independent given the parameters."""
        mixture = self.condition(points, values)
        return logsumexp(latent(mixture, points.t).log_joint, axis=1)

    def points(self, data: PointData) -> dict[str, tuple[str, np.ndarray]]:
        """Return the names of the points."""
        return {"point": ("point", np.array(data.names))}

    def dims(self) -> dict[str, tuple[str, ...]]:
        """Return the dimensions of every site and of what is identified."""
        return {
            "t": ("point", "bin"),
            "weight": ("component",),
            "mean": ("component", "bin"),
            "factor": ("component", "bin", "latent"),
            "noise": ("component",),
            "log_likelihood": (),
            "overall_mean": ("bin",),
            "overall_covariance": ("bin", "other_bin"),
            "sorted_weight": ("rank",),
            "sorted_noise": ("rank",),
            "log_density": ("landmark",),
        }

    def coords(self, data: PointData) -> dict[str, list]:
        """Return the labels of every dimension."""
        return {
            "point": list(data.names),
            "bin": list(data.labels),
            "other_bin": list(data.labels),
            "component": list(range(self.components)),
            "latent": list(range(self.latent)),
            "rank": list(range(self.components)),
            "landmark": [data.names[i] for i in landmarks(len(data.names))],
        }

    def sbc_case(self) -> tuple[SBCCase, Points]:
        """Return two components of one direction each, and sixteen points in the plane."""
        return sbc.case(MixturePPCA(components=2, latent=1))


def landmarks(count: int) -> np.ndarray:
    """Return the numbers of at most `LANDMARKS` evenly chosen points."""
    return np.unique(np.linspace(0, count - 1, min(count, LANDMARKS)).round().astype(int))
