"""What a trained chain says of new clips: mixtures of its states' normals.

The states' probabilities given all that is seen of a clip mix their normals, frame by frame.
In a frame of which some entries of an output are seen, the others have the state's normal
given those; entries that are seen are predicted as they would be measured again.
"""

from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from ...gp.linalg import AnyArray, cholesky
from ...prediction import NormalEntries
from .data import Frames
from .hidden_markov import Chain, Recursions, draw_path, fill, recursions

if TYPE_CHECKING:
    from .program import VoicePuppetry

COMPONENTS = 64


class Trained(NamedTuple):
    """Site values of one draw: all that new clips depend on."""

    values: dict[str, AnyArray]


class StateMixture(NamedTuple):
    """Frames whose entries are mixtures of normals, one a state.

    chain, filtered, posterior
        The chain, and log probabilities (N, K) of its states given frames so far and given all.
    means
        (N, K, D) of every frame under every state.
    covariance, which
        (P, K, D, D) by pattern of what is seen, and (N,) the pattern of every frame.
    """

    chain: Chain
    filtered: Float[AnyArray, "n k"]
    posterior: Float[AnyArray, "n k"]
    means: Float[AnyArray, "n k d"]
    covariance: Float[AnyArray, "p k d d"]
    which: Int[AnyArray, " n"]

    @property
    def mean(self) -> Float[Array, "n d"]:
        """Mean of every entry."""
        return jnp.einsum("nk,nkd->nd", jnp.exp(jnp.asarray(self.posterior)), self.means)

    @property
    def variance(self) -> Float[Array, "n d"]:
        """Variance of every entry, that between states included."""
        share = jnp.exp(jnp.asarray(self.posterior))
        away = self.means - self.mean[:, None]
        return jnp.einsum("nk,nkd->nd", share, self._variances() + away**2)

    def marginals(self, key: PRNGKeyArray) -> NormalEntries:
        """Return `COMPONENTS` normals of every entry, alike in weight (J, N, D).

        States are drawn at even distances of their distribution function, so that each has its
        probability, up to one component.
        """
        mass = jnp.cumsum(jnp.exp(jnp.asarray(self.posterior)), axis=1)
        at = (jnp.arange(COMPONENTS) + jax.random.uniform(key)) / COMPONENTS
        state = jnp.sum(at[:, None, None] * mass[:, -1:] > mass, axis=2)
        state = jnp.minimum(state, mass.shape[1] - 1)
        frame = jnp.arange(mass.shape[0])
        return NormalEntries(jnp.asarray(self.means)[frame, state], self._variances()[frame, state])

    def sample(self, key: PRNGKeyArray) -> Float[Array, "n d"]:
        """Draw all entries together, along a path of states; equal keys give equal paths."""
        path_key, white_key = jax.random.split(key)
        path = draw_path(path_key, self.chain, self.filtered)
        roots = jax.vmap(jax.vmap(cholesky))(jnp.asarray(self.covariance))
        means = jnp.asarray(self.means)[jnp.arange(len(path)), path]
        white = jax.random.normal(white_key, means.shape)
        return means + jnp.einsum("nde,ne->nd", roots[self.which, path], white)

    def _variances(self) -> Float[Array, "n k d"]:
        return jnp.diagonal(jnp.asarray(self.covariance), axis1=2, axis2=3)[self.which]


def state_recursions(
    model: "VoicePuppetry", trained: Trained, frames: Frames
) -> tuple[Chain, Recursions]:
    """Return the chain, and what is known of its states from all that is seen."""
    chain = model.chain(trained.values, frames)
    return chain, recursions(chain, model.emissions(trained.values, frames))


def predict(model: "VoicePuppetry", trained: Trained, frames: Frames) -> dict[str, StateMixture]:
    """Predict every entry of all outputs."""
    chain, found = state_recursions(model, trained, frames)
    out = {}
    for name in model.outputs:
        mean = jnp.asarray(trained.values[f"{name}_mean"])
        precision = jnp.asarray(trained.values[f"{name}_precision"])
        rows = frames.rows[name]
        filled, left = fill(mean, precision, frames.y[name], rows)
        seen = jnp.asarray(rows.seen)
        both = seen[:, None, :, None] * seen[:, None, None, :]
        covariance = left + both * jnp.linalg.inv(precision)
        means = jnp.where(seen[rows.which][:, None] > 0, mean, filled)
        out[name] = StateMixture(
            chain, found.filtered, found.posterior, means, covariance, jnp.asarray(rows.which)
        )
    return out
