"""What the multifactor model gives to forecasts: itself once trained, and predicted outputs."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float, PRNGKeyArray

from ..gp.linalg import AnyArray
from ..gp.matrix_normal import Conditioned
from ..priors.dynamics import GivenSteps


class Given(NamedTuple):
    """A trained model that new clips are seen in the light of.

    hyper
        Trained values of gamma, beta, scale, and alpha where there is one.
    styles
        For each factor the trained style vectors (L, S), with their spare entries.
    points
        Factors and content of the training frames.
    conditioned
        The outputs' process conditioned on the training frames.
    steps
        The dynamics conditioned on the training steps, None for the circle.
    """

    hyper: dict[str, AnyArray]
    styles: dict[str, AnyArray]
    points: dict[str, AnyArray]
    conditioned: Conditioned
    steps: GivenSteps | None


class Prediction(NamedTuple):
    """Predicted outputs of N frames, in scaled features.

    mean
        (N, D).
    covariance
        (P, N, N) of the noise-free outputs of scale 1, for each pattern of missing entries.
    noise
        Variance of the noise of an output of scale 1.
    scale
        (D,): column d has the covariance (covariance + noise I) / scale_d^2.
    columns
        (P, D) which columns each pattern's covariance is for.
    stray
        Shape and rate (D,) each of the inverse gamma distribution of what the covariance
        of a column is multiplied by; None for one.
    """

    mean: Float[AnyArray, "n d"]
    covariance: Float[AnyArray, "p n n"]
    noise: Float[AnyArray, ""]
    scale: Float[AnyArray, " d"]
    columns: Float[AnyArray, "p d"]
    stray: tuple[Float[AnyArray, " d"], Float[AnyArray, " d"]] | None = None

    def variance(self, key: PRNGKeyArray | None = None) -> Float[AnyArray, "n d"]:
        """Variance of every entry, noise included; with a key, given a draw of `stray`."""
        diagonal = jnp.diagonal(self.covariance, axis1=1, axis2=2) + self.noise
        normal = jnp.einsum("pn,pd->nd", diagonal, self.columns) / self.scale**2
        if self.stray is None:
            return normal
        shape, rate = self.stray
        if key is None:
            return normal * rate / (shape - 1.0)
        return normal * rate / jax.random.gamma(key, shape)
