"""Outputs that are functions of a phase and of linear styles: exact at any number of frames.

The covariance of an output of scale 1 over the N frames of C clips is

    K = (product of linear style kernels) x (RBF kernel on a circle) + residual + noise,

and with the harmonics f of a frame's phase (`harmonics`) and the Kronecker product s of its clip's
styles, K = Phi Phi^T + V with rows phi_n = f_n (x) s_n of R = (2 J + 1) S entries, whatever N is.
V, every clip's own residual and white noise, is whitened in O(N) (`markov`). With

    A = I + Phi^T V^-1 Phi,   b = Phi^T V^-1 y,
    log |K| = log |A| + log |V|,   y^T K^-1 y = y^T V^-1 y - b^T A^-1 b

a density costs N (2 J + 1) (2 J + 1 + D) + R^3: styles are constant within a clip, whose part
of A is (F^T V^-1 F) (x) (s s^T).

The outputs are Phi w + residual + noise with w ~ N(0, I), and given data w ~ N(A^-1 b, A^-1):
that is all that predictions elsewhere need.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from .harmonics import amplitudes, fewest, waves
from .linalg import JITTER, AnyArray, cholesky, inverse_factor
from .markov import Lanes, draw, whiten
from .matrix_normal import OfColumns, Patterns, over_patterns, quadratic_logdet, seen_entries

# Numbers of harmonics of which the fewest that are enough are taken: for gamma up to 2.3, and 23.
CHOICES = (16, 40)


class CircleCovariance(NamedTuple):
    """The covariance of one output of scale 1 over the frames of clips.

    gamma
        Inverse squared length scale on the circle.
    content
        (N, 2) points of the unit circle.
    styles
        (C, S) Kronecker product of every clip's style vectors; ones (C, 1) without styles.
    variance, time_scale
        (C,) of the residuals.
    noise
        Variance of the noise.
    time
        (N,) of the frames, in the unit of the time scales.
    lanes
        Where the frames lie.
    """

    gamma: Float[AnyArray, ""]
    content: Float[AnyArray, "n 2"]
    styles: Float[AnyArray, "c s"]
    variance: Float[AnyArray, " c"]
    time_scale: Float[AnyArray, " c"]
    noise: Float[AnyArray, ""]
    time: Float[AnyArray, " n"]
    lanes: Lanes

    @property
    def shape(self) -> tuple[int, ...]:
        """N and N."""
        return len(self.time), len(self.time)

    def misfit_of_columns(self, residual: Float[AnyArray, "n d"], missing: Patterns) -> OfColumns:
        """Give r^T K^-1 r, log |K| and the number of seen entries r, for every column (D,)."""
        return _by_fewest(self.gamma, lambda harmonics: _misfit(self, harmonics, residual, missing))

    def condition(
        self, residual: Float[AnyArray, "n d"], missing: Patterns
    ) -> "ConditionedOnCircle":
        """Condition on the seen entries of `residual` = Y - loc."""
        found = _by_fewest(
            self.gamma, lambda harmonics: _weights(self, harmonics, residual, missing)
        )
        return ConditionedOnCircle(*found, self.gamma, missing)

    def inverse(
        self, residual: Float[AnyArray, "n d"], pattern: Patterns
    ) -> tuple[Float[Array, " n"], Float[Array, "n d"]]:
        """Give the diagonal of K^-1 and K^-1 y for the entries that one pattern has seen."""
        seen = tuple(map(jnp.asarray, (residual, pattern.rows, pattern.columns)))
        return _by_fewest(self.gamma, lambda harmonics: _inverse(self, harmonics, *seen))

    def sample(
        self, key: PRNGKeyArray, shape: tuple[int, ...], columns: int
    ) -> Float[Array, "*s n d"]:
        """Draw so many columns of scale 1."""
        keys = jax.random.split(key, math.prod(shape))
        drawn = jax.vmap(partial(self._draw, columns))(keys)
        return drawn.reshape(*shape, *drawn.shape[1:])

    def _draw(self, columns: int, key: PRNGKeyArray) -> Float[Array, "n d"]:
        on_weights, on_residual, on_noise = jax.random.split(key, 3)
        lanes, n = self.lanes, len(self.time)
        features = waves(self.content, amplitudes(self.gamma, CHOICES[-1]))
        styles = lanes.taken(jax.vmap(lanes.of_clips, 1, 2)(self.styles), n)
        weights = jax.random.normal(on_weights, (features.shape[1], styles.shape[1], columns))
        white = jax.random.normal(on_residual, (*lanes.frame.shape, columns))
        noise = jax.random.normal(on_noise, (n, columns))
        mean = jnp.einsum("ni,ns,isd->nd", features, styles, weights, optimize="optimal")
        return mean + lanes.taken(draw(white, *self.residual()), n) + jnp.sqrt(self.noise) * noise

    def residual(self) -> tuple[Float[Array, "t l"], Float[Array, "t l"]]:
        """Return the correlation with the frame before, and the variance, place by place."""
        time, follows = self.lanes.placed(self.time), jnp.asarray(self.lanes.follows)
        apart = jnp.diff(time, axis=0, prepend=time[:1]) * follows
        decay = follows * jnp.exp(-apart / self.lanes.of_clips(self.time_scale))
        return decay, self.lanes.of_clips(self.variance)

    def noise_of(self, rows: Array) -> Float[Array, " n"]:
        """Return the noise of every frame, with what the one jitter policy adds to K."""
        styles, variance = self.lanes.of_clips(jnp.sum(self.styles**2, axis=1)), self.residual()[1]
        seen = self.lanes.placed(rows)
        trace = jnp.sum(seen * (styles + variance + self.noise)) + jnp.sum(1.0 - rows)
        jitter = jax.lax.stop_gradient(JITTER * trace / len(rows))
        return jnp.full(len(rows), self.noise + jitter)


def _by_fewest[Found](gamma: Float[AnyArray, ""], of: Callable[[int], Found]) -> Found:
    """Return what a function gives of the fewest harmonics that are enough.

    Only that is computed, but in a batch, where it may be another one for each.
    """
    choices = [partial(of, harmonics) for harmonics in CHOICES]
    return jax.lax.switch(fewest(gamma, CHOICES), choices)


def _misfit(
    K: CircleCovariance, harmonics: int, residual: Float[AnyArray, "n d"], missing: Patterns
) -> OfColumns:
    # What the backward pass needs of a pattern is found again: it is much, and quickly found.
    @jax.checkpoint
    def one(pattern: Patterns) -> OfColumns:
        rows, columns = jnp.asarray(pattern.rows), jnp.asarray(pattern.columns)
        y = seen_entries(residual, rows, columns)
        misfit, logdet = _misfit_logdet(K, harmonics, y, rows, K.noise_of(rows))
        return columns * misfit, columns * logdet, columns * jnp.sum(rows)

    return over_patterns(one, missing)


def _weights(
    K: CircleCovariance, harmonics: int, residual: Float[AnyArray, "n d"], missing: Patterns
) -> tuple[Float[Array, "p r r"], Float[Array, "p r d"]]:
    """Return the inverse factors and halves, as of all harmonics: more than enough tell nothing."""
    more = 2 * (CHOICES[-1] - harmonics) * K.styles.shape[1]

    def one(pattern: tuple[Array, Array]) -> tuple[Array, Array]:
        rows, columns = pattern
        y = seen_entries(residual, rows, columns)
        A, b, _, _ = _statistics(K, harmonics, y, rows, K.noise_of(rows))
        inverse = inverse_factor(cholesky(A, 0.0))
        whole = jax.scipy.linalg.block_diag(inverse, jnp.eye(more))
        return whole, jnp.pad(inverse @ b, ((0, more), (0, 0)))

    return jax.lax.map(one, (jnp.asarray(missing.rows), jnp.asarray(missing.columns)))


def _inverse(
    K: CircleCovariance, harmonics: int, residual: Array, rows: Array, columns: Array
) -> tuple[Float[Array, " n"], Float[Array, "n d"]]:
    """Return the diagonal of K^-1 and K^-1 y of what a pattern has seen, as derivatives.

    d log |K| / d noise_n = (K^-1)_nn, and d (y^T K^-1 y / 2) / dy = K^-1 y.
    """

    def halves(y: Array, noise: Array) -> tuple[Array, Array]:
        misfit, logdet = _misfit_logdet(K, harmonics, y, rows, noise)
        return 0.5 * jnp.sum(misfit), logdet

    at = (seen_entries(residual, rows, columns), K.noise_of(rows))
    (misfit, logdet), pull = jax.vjp(halves, *at)
    one, none = jnp.ones_like(misfit), jnp.zeros_like(logdet)
    diagonal = pull((none, one))[1]
    return jnp.where(rows > 0.0, diagonal, 1.0), pull((one, none))[0]


def _misfit_logdet(
    K: CircleCovariance, harmonics: int, y: Array, rows: Array, noise: Array
) -> tuple[Float[Array, " d"], Float[Array, ""]]:
    A, b, squares, logdet = _statistics(K, harmonics, y, rows, noise)
    explained, more = quadratic_logdet(A, b, 0.0)
    return squares - explained, logdet + more


def _statistics(
    K: CircleCovariance,
    harmonics: int,
    y: Float[Array, "n d"],
    rows: Float[Array, " n"],
    noise: Float[Array, " n"],
) -> tuple[Float[Array, "r r"], Float[Array, "r d"], Float[Array, " d"], Float[Array, ""]]:
    """Return A, b, y^T V^-1 y and log |V| of the rows that a pattern has seen."""
    lanes, amplitude = K.lanes, amplitudes(K.gamma, harmonics)
    features = jax.vmap(waves, (0, None))(lanes.placed(K.content), amplitude)
    both = jnp.concatenate([features, lanes.placed(y)], axis=2)
    white, logdet = whiten(both, lanes.placed(rows), *K.residual(), lanes.placed(noise))
    of_features, of_y = jnp.split(lanes.blocks(white), [features.shape[2]], axis=2)
    styles = jnp.asarray(K.styles)[lanes.clip.ravel()]
    gram = jnp.einsum("bni,bnj->bij", of_features, of_features)
    A = jnp.einsum("bst,bij->isjt", styles[:, :, None] * styles[:, None, :], gram)
    b = jnp.einsum("bs,bid->isd", styles, jnp.einsum("bni,bnd->bid", of_features, of_y))
    R = features.shape[2] * styles.shape[1]
    squares = jnp.sum(of_y**2, axis=(0, 1))
    return jnp.eye(R) + A.reshape(R, R), b.reshape(R, -1), squares, logdet


class ConditionedOnCircle(NamedTuple):
    """What is known of the weights w after seeing data, kept for reuse at new points.

    inverse
        (P, R, R) inverse Cholesky factor of each pattern's A.
    half
        (P, R, D) the same times b, zero in the columns of other patterns.
    gamma
        Inverse squared length scale on the circle.
    missing
        The patterns.
    """

    inverse: Float[AnyArray, "p r r"]
    half: Float[AnyArray, "p r d"]
    gamma: Float[AnyArray, ""]
    missing: Patterns

    def __call__(
        self,
        content: Float[AnyArray, "m 2"],
        styles: Float[AnyArray, "m s"],
        K: Float[AnyArray, "m m"],
    ) -> tuple[Float[Array, "m d"], Float[Array, "p m m"]]:
        """Predict at m new points: mean (M, D) and each pattern's covariance (P, M, M).

        content, styles
            Of the new points, as those of `CircleCovariance`.
        K
            (M, M) covariance among the new points beforehand.
        """
        points = (jnp.asarray(content), jnp.asarray(styles), jnp.asarray(K))
        return _by_fewest(self.gamma, lambda harmonics: _predicted(self, harmonics, *points))

    def weights(self, harmonics: int) -> "Weights":
        """Return the moments of the weights of so many harmonics, those that are enough."""
        styles = self.inverse.shape[1] // (2 * CHOICES[-1] + 1)
        features = 2 * harmonics + 1
        R = features * styles
        inverse, half = jnp.asarray(self.inverse)[:, :R, :R], jnp.asarray(self.half)[:, :R]
        covariance = jnp.einsum("kri,krj->kij", inverse, inverse)
        mean = jnp.einsum("kri,krd->id", inverse, half).reshape(features, styles, -1)
        shape = (features, styles, features, styles)
        return Weights(mean, covariance.reshape(-1, *shape))


class Weights(NamedTuple):
    """Moments of the weights of F features and S products of styles, given data.

    mean, covariance
        (F, S, D) and (P, F, S, F, S).
    """

    mean: Float[AnyArray, "f s d"]
    covariance: Float[AnyArray, "p f s f s"]

    def of_style(
        self, style: Float[AnyArray, " s"]
    ) -> tuple[Float[Array, "f d"], Float[Array, "p f f"]]:
        """Return mean (F, D) and covariances (P, F, F) of the features' weights at one style."""
        style = jnp.asarray(style)
        half = jnp.asarray(self.covariance) @ style
        covariance = jnp.einsum("pfsg,s->pfg", half, style)
        return jnp.einsum("fsd,s->fd", jnp.asarray(self.mean), style), covariance


def _predicted(
    given: ConditionedOnCircle, harmonics: int, content: Array, styles: Array, K: Array
) -> tuple[Float[Array, "m d"], Float[Array, "p m m"]]:
    features = waves(content, amplitudes(given.gamma, harmonics))
    phi = (features[:, :, None] * styles[:, None, :]).reshape(len(features), -1)
    unexplained, R = K - phi @ phi.T, phi.shape[1]

    def one(inverse: Array, half: Array) -> tuple[Array, Array]:
        gain = phi @ inverse[:R, :R].T
        return gain @ half[:R], unexplained + gain @ gain.T

    means, covariances = jax.vmap(one)(jnp.asarray(given.inverse), jnp.asarray(given.half))
    return jnp.sum(means, axis=0), covariances
