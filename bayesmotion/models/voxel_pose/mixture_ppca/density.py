"""The density of a mixture of PPCA and what it says of points some of whose bins are seen.

The seen part o of a point is a point of the same mixture with the rows o of mu and W. With
M = W_o^T W_o + sigma^2 I, its latent numbers given a component are

    z | t_o, k ~ N(M^-1 W_o^T (t_o - mu_o), sigma^2 M^-1)
    (t_o - mu_o)^T C_o^-1 (t_o - mu_o) = (|t_o - mu_o|^2 - |L^-1 W_o^T (t_o - mu_o)|^2) / sigma^2
    log |C_o| = (|o| - Q) log sigma^2 + log |M|,    M = L L^T

and a bin, seen or not, is W_d z + mu_d and noise: no matrix (D, D) is needed.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular
from jax.scipy.special import logsumexp
from jaxtyping import Array, Float, Int, PRNGKeyArray
from numpyro import distributions as dist

from ....gp.linalg import AnyArray, cholesky
from ....prediction import NormalEntries

LOG_2PI = 1.8378770664093453
# Points whose densities under all components are in memory together.
BLOCK = 4096


class Mixture(NamedTuple):
    """One draw of the parameters: pi (K,), mu (K, D), W (K, D, Q), sigma^2 (K,)."""

    weight: Float[AnyArray, " k"]
    mean: Float[AnyArray, "k d"]
    factor: Float[AnyArray, "k d q"]
    noise: Float[AnyArray, " k"]

    def covariances(self) -> Float[Array, "k d d"]:
        """Return C_k."""
        W = jnp.asarray(self.factor)
        return jnp.einsum("kdq,keq->kde", W, W) + self.noise[:, None, None] * jnp.eye(W.shape[1])


class Latent(NamedTuple):
    """What the seen bins of N points say of component and latent numbers.

    log_joint
        (N, K) log pi_k p(t_o | k).
    mean, root
        (N, K, Q) and (N, K, Q, Q): z given a component is ``mean + root @ white``.
    """

    log_joint: Float[AnyArray, "n k"]
    mean: Float[AnyArray, "n k q"]
    root: Float[AnyArray, "n k q q"]


def latent(mixture: Mixture, t: Float[AnyArray, "n d"]) -> Latent:
    """Return what points (N, D), NaN where missing, say of component and latent numbers."""
    W, noise = jnp.asarray(mixture.factor), jnp.asarray(mixture.noise)
    K, Q = len(noise), W.shape[2]
    seen = ~jnp.isnan(t)
    count = seen.sum(axis=1)[:, None]
    away = jnp.where(seen, t, 0.0)[:, None] - seen[:, None] * mixture.mean
    M = jnp.einsum("nd,kdq,kdr->nkqr", seen.astype(W.dtype), W, W)
    M = M + noise[:, None, None] * jnp.eye(Q)
    inverse = jax.vmap(jax.vmap(_inverse_factor))(M)
    half = jnp.einsum("nkqr,nkr->nkq", inverse, jnp.einsum("nkd,kdq->nkq", away, W))
    squared = ((away**2).sum(axis=2) - (half**2).sum(axis=2)) / noise
    diagonal = jnp.diagonal(inverse, axis1=2, axis2=3)
    log_det = (count - Q) * jnp.log(noise) - 2.0 * jnp.log(diagonal).sum(axis=2)
    log_joint = jnp.log(mixture.weight) - 0.5 * (count * LOG_2PI + log_det + squared)
    mean = jnp.einsum("nkrq,nkr->nkq", inverse, half)
    root = jnp.sqrt(noise)[:, None, None] * inverse.swapaxes(2, 3)
    return Latent(log_joint.reshape(len(t), K), mean, root)


def responsibilities(mixture: Mixture, t: Float[AnyArray, "n d"]) -> Float[Array, "n k"]:
    """Return p(k | t_n) of points without missing bins, some at a time, by matrix products."""
    W, noise = jnp.asarray(mixture.factor), jnp.asarray(mixture.noise)
    K, D, Q = W.shape
    # Measured from the centre, so that squares hardly cancel.
    centre = mixture.mean.mean(axis=0)
    mean = mixture.mean - centre
    M = jnp.einsum("kdq,kdr->kqr", W, W) + noise[:, None, None] * jnp.eye(Q)
    inverse = jax.vmap(_inverse_factor)(M)
    maps = jnp.einsum("kqr,kdr->dkq", inverse, W)
    shift = jnp.einsum("kd,dkq->kq", mean, maps)
    diagonal = jnp.diagonal(inverse, axis1=1, axis2=2)
    log_det = (D - Q) * jnp.log(noise) - 2.0 * jnp.log(diagonal).sum(axis=1)
    constant = jnp.log(mixture.weight) - 0.5 * log_det

    def one(point: Array) -> Array:
        away = point.astype(W.dtype) - centre
        inner = (away @ maps.reshape(D, K * Q)).reshape(K, Q) - shift
        squared = away @ away - 2.0 * mean @ away + (mean**2).sum(axis=1) - (inner**2).sum(axis=1)
        return jax.nn.softmax(constant - 0.5 * squared / noise)

    return jax.lax.map(one, jnp.asarray(t), batch_size=BLOCK)


def _inverse_factor(M: Float[AnyArray, "q q"]) -> Float[Array, "q q"]:
    return solve_triangular(cholesky(M), jnp.eye(len(M)), lower=True)


class PPCAMixture(dist.Distribution):
    """N independent points (N, D) of a mixture; NaN in a value is integrated out."""

    pytree_data_fields = ("mixture",)
    pytree_aux_fields = ("points",)

    def __init__(self, mixture: Mixture, points: int) -> None:
        self.mixture, self.points = mixture, points
        super().__init__((points,), (mixture.mean.shape[1],))

    @property
    def support(self) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Vectors of real numbers."""
        return dist.constraints.real_vector

    def sample(self, key: PRNGKeyArray, sample_shape: tuple[int, ...] = ()) -> Array:
        """Draw points."""
        shape = (*sample_shape, self.points)
        component_key, latent_key, noise_key = jax.random.split(key, 3)
        log_weight = jnp.log(self.mixture.weight)
        k = jax.random.categorical(component_key, log_weight, shape=shape)
        _, D, Q = self.mixture.factor.shape
        z = jax.random.normal(latent_key, (*shape, Q))
        white = jax.random.normal(noise_key, (*shape, D))
        W, noise = jnp.asarray(self.mixture.factor)[k], jnp.asarray(self.mixture.noise)[k]
        t = jnp.asarray(self.mixture.mean)[k] + jnp.einsum("...dq,...q->...d", W, z)
        return t + jnp.sqrt(noise)[..., None] * white

    def log_prob(self, value: AnyArray) -> Array:
        """Return the log density (N,) of the seen bins of every point."""
        return logsumexp(latent(self.mixture, value).log_joint, axis=1)


class PPCAPredictive(NamedTuple):
    """Every bin of N points given those that are seen: a mixture over the components.

    share
        (N, K) responsibilities.
    mean, root
        Of the latent numbers, see `Latent`.
    mixture
        The parameters.
    """

    share: Float[AnyArray, "n k"]
    latent_mean: Float[AnyArray, "n k q"]
    latent_root: Float[AnyArray, "n k q q"]
    mixture: Mixture

    @classmethod
    def of(cls, mixture: Mixture, t: Float[AnyArray, "n d"]) -> "PPCAPredictive":
        """Condition on points, NaN where missing."""
        found = latent(mixture, t)
        return cls(jax.nn.softmax(found.log_joint, axis=1), found.mean, found.root, mixture)

    @property
    def mean(self) -> Float[AnyArray, "n d"]:
        """Mean of every entry over the components."""
        return jnp.einsum("nk,nkd->nd", self.share, self._means())

    @property
    def variance(self) -> Float[AnyArray, "n d"]:
        """Variance of every entry over the components, noise included."""
        apart = self._means() - self.mean[:, None]
        return jnp.einsum("nk,nkd->nd", self.share, self._variances() + apart**2)

    def marginals(self, key: PRNGKeyArray) -> NormalEntries:
        """Return the moments given a component of every point, drawn with the key."""
        k = self._draw(key)
        rows = jnp.arange(len(k))
        return NormalEntries(self._means()[rows, k], self._variances()[rows, k])

    def sample(self, key: PRNGKeyArray) -> Float[Array, "n d"]:
        """Draw the bins of every point together, noise included."""
        component_key, latent_key, noise_key = jax.random.split(key, 3)
        k = self._draw(component_key)
        rows = jnp.arange(len(k))
        z = jnp.asarray(self.latent_mean)[rows, k]
        white = jax.random.normal(latent_key, z.shape)
        z = z + jnp.einsum("nqr,nr->nq", jnp.asarray(self.latent_root)[rows, k], white)
        t = jnp.asarray(self.mixture.mean)[k]
        t = t + jnp.einsum("ndq,nq->nd", jnp.asarray(self.mixture.factor)[k], z)
        sd = jnp.sqrt(jnp.asarray(self.mixture.noise)[k])[:, None]
        return t + sd * jax.random.normal(noise_key, t.shape)

    def _draw(self, key: PRNGKeyArray) -> Int[Array, " n"]:
        return jax.random.categorical(key, jnp.log(self.share), axis=1)

    def _means(self) -> Float[Array, "n k d"]:
        return jnp.asarray(self.mixture.mean) + jnp.einsum(
            "kdq,nkq->nkd", jnp.asarray(self.mixture.factor), jnp.asarray(self.latent_mean)
        )

    def _variances(self) -> Float[Array, "n k d"]:
        known = jnp.einsum(
            "kdq,nkqr->nkdr", jnp.asarray(self.mixture.factor), jnp.asarray(self.latent_root)
        )
        return (known**2).sum(axis=3) + jnp.asarray(self.mixture.noise)[:, None]
