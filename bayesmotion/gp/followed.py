"""One clip on a circle, followed frame by frame: what its frames say, of a fixed size.

Given a trained process (`on_circle.ConditionedOnCircle`) the outputs of a clip of constant styles
are, at the phase theta_t and with the harmonics e_t = (1, cos theta_t, sin theta_t, ...),

    y_td = e_t^T c_d + (u_td + white noise) / w_d,    c_d ~ N(m_d, L L^T / w_d^2)

with as many coefficients c_d as harmonics, and u an Ornstein-Uhlenbeck process. With V the
covariance of u and noise, all that the frames say of c is in sums over them,

    G = E^T V^-1 E,   b_d = E^T V^-1 y_d,   q_d = y_d^T V^-1 y_d,   log |V|,

to which a frame adds whitened by a scalar Kalman filter (`markov`), and in the filter's state:
u_t | c, y ~ N(outputs_d - features^T c_d, variance). So frames that are gone (`Past`) take as
much memory and time as few do, and those of a window are whitened by one small matrix.

Columns that were seen in the same frames are a group, and share G, log |V| and the filter.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .linalg import AnyArray, cholesky
from .markov import errors
from .matrix_normal import LOG_2PI, quadratic_logdet


class Past(NamedTuple):
    """What frames that are gone say; H groups of columns, F harmonics, D columns.

    gram, product, squares, log_det
        G (H, F, F), b (F, D), q (D,) and log |V| (H,).
    count
        (H,) frames seen.
    features, outputs, variance
        (H, F), (D,) and (H,): the filter's state.
    begun
        1 where there is a frame that is gone, else 0.
    """

    gram: Float[Array, "h f f"]
    product: Float[Array, "f d"]
    squares: Float[Array, " d"]
    log_det: Float[Array, " h"]
    count: Float[Array, " h"]
    features: Float[Array, "h f"]
    outputs: Float[Array, " d"]
    variance: Float[Array, " h"]
    begun: Float[Array, ""]

    def split(self, parent: Int[AnyArray, " g"]) -> "Past":
        """Return that of groups into which these have been split, of a group of these each."""
        whole = {name: getattr(self, name) for name in ("product", "squares", "outputs", "begun")}
        parts = {name: part[parent] for name, part in self._asdict().items() if name not in whole}
        return self._replace(**parts)


def nothing(groups: int, features: int, columns: int) -> Past:
    """Return what no frame says."""
    of_groups = jnp.zeros(groups)
    return Past(
        jnp.zeros((groups, features, features)), jnp.zeros((features, columns)), jnp.zeros(columns),
        of_groups, of_groups, jnp.zeros((groups, features)), jnp.zeros(columns), of_groups,
        jnp.zeros(()),
    )  # fmt: skip


class Residual(NamedTuple):
    """Of outputs of scale 1: the residual's variance, its correlation with the frame before, noise.

    variance, decay, noise
        sigma^2, exp(-1 / tau) and nu.
    """

    variance: Float[Array, ""]
    decay: Float[Array, ""]
    noise: Float[Array, ""]


class Coefficients(NamedTuple):
    """What is known of the coefficients before the clip.

    mean
        (F, D).
    root
        (G, F, F) L of every group.
    """

    mean: Float[Array, "f d"]
    root: Float[Array, "g f f"]


class Rows(NamedTuple):
    """The frames of a window: T rows, of which the first may be filled.

    y
        (T, D) outputs, zero where not seen.
    seen
        (G, T) 1 where a group is seen.
    columns
        (G, D) 1 for the columns of a group.
    parent
        (G,) which group of the `Past` a group is part of.
    filled
        How many rows are frames; the others are not seen.
    """

    y: Float[AnyArray, "t d"]
    seen: Float[AnyArray, "g t"]
    columns: Float[AnyArray, "g d"]
    parent: Int[AnyArray, " g"]
    filled: Int[AnyArray, ""]


class Ahead(NamedTuple):
    """What is said of N frames that follow, as `prediction.GPPredictive` has it.

    mean, covariance
        (N, D), and (G, N, N) of outputs of scale 1 without noise.
    wider
        Shape and rate (D,) of what the covariance is multiplied by; None for one.
    """

    mean: Float[Array, "n d"]
    covariance: Float[Array, "g n n"]
    wider: tuple[Float[Array, " d"], Float[Array, " d"]] | None


class _Filter(NamedTuple):
    """What is left of rows (T, G, F + D) once their past is known, and the filter's gains (T, G).

    errors, learned
        z - its mean given the past, and the part of the past that began with the window in
        what is known after a row.
    gain, variance
        Of the filter.
    """

    errors: Array
    learned: Array
    gain: Array
    variance: Array


class Followed(NamedTuple):
    """What past and window say together, of G groups; fields as of `Past`, and the filter."""

    gram: Float[Array, "g f f"]
    product: Float[Array, "f d"]
    squares: Float[Array, " d"]
    log_det: Float[Array, " g"]
    count: Float[Array, " g"]
    filter: _Filter


def follow(past: Past, rows: Rows, waves: Float[AnyArray, "t f"], residual: Residual) -> Followed:
    """Return what past and window say, the harmonics of its rows being given."""
    of, seen = past.split(rows.parent), jnp.asarray(rows.seen)
    gain, total, variance = _gains(of, seen, residual)
    z = _both(rows, jnp.asarray(waves), residual, of)
    decay = jnp.full(gain.shape, residual.decay)
    off = errors(z, decay, gain)
    learned = z - (1.0 - gain)[:, :, None] * off
    white = (seen.T / jnp.sqrt(total))[:, :, None] * off
    white_waves, y = white[:, :, : waves.shape[1]], white[:, :, waves.shape[1] :]
    return Followed(
        of.gram + jnp.einsum("tgi,tgj->gij", white_waves, white_waves),
        past.product + jnp.einsum("tgf,tgd->fd", white_waves, y),
        past.squares + jnp.sum(y**2, axis=(0, 1)),
        of.log_det + jnp.sum(seen.T * jnp.log(total), axis=0),
        of.count + jnp.sum(seen, axis=1),
        _Filter(off, learned, gain, variance),
    )


def log_density(
    followed: Followed, rows: Rows, known: Coefficients, scale: Float[AnyArray, " d"]
) -> Float[Array, ""]:
    """Return the log density of all frames."""
    misfit, log_det, count = _misfit(followed, rows, known)
    scale = jnp.asarray(scale)
    each = count * jnp.log(scale) - 0.5 * scale**2 * misfit - 0.5 * (log_det + count * LOG_2PI)
    return jnp.sum(each)


def ahead(
    past: Past,
    rows: Rows,
    followed: Followed,
    known: Coefficients,
    residual: Residual,
    waves: tuple[Float[AnyArray, "t f"], Float[AnyArray, "n f"]],
    scale: Float[AnyArray, " d"],
    student_df: float | None,
) -> Ahead:
    """Predict the frames that follow; `waves` are the harmonics of the window and of these.

    With `student_df` the covariance of every column is multiplied by what its misfit tells
    (`matrix_normal.spread_of_columns`).
    """
    here, there = map(jnp.asarray, waves)
    features = here.shape[1]
    learned, outputs, variance = _state(past, rows, residual, followed.filter, features)
    away = jnp.arange(1.0, len(there) + 1.0)
    fading = residual.decay**away
    seen_from = there - fading[:, None] * learned[:, None, :]
    mean, root = _posterior(followed, rows, known)
    memory = fading[:, None] * outputs
    of_columns = jnp.einsum("gd,gnf,fd->nd", rows.columns, seen_from, mean, optimize="optimal")
    lag = residual.decay ** jnp.abs(away[:, None] - away)
    both = fading[:, None] * fading
    fresh = residual.variance * (lag - both) + variance[:, None, None] * both
    gain = seen_from @ root
    wider = None
    if student_df is not None:
        misfit, _, count = _misfit(followed, rows, known)
        rate = 0.5 * (student_df + jnp.asarray(scale) ** 2 * misfit)
        wider = 0.5 * (student_df + count), rate
    return Ahead(of_columns + memory, gain @ jnp.swapaxes(gain, 1, 2) + fresh, wider)


def gone(
    past: Past,
    y: Float[AnyArray, " d"],
    seen: Float[AnyArray, " h"],
    group: Int[AnyArray, " d"],
    waves: Float[AnyArray, " f"],
    residual: Residual,
) -> Past:
    """Return the past with one more frame; `group` is that of every column, `y` zero elsewhere."""
    decay = residual.decay
    before = jnp.where(past.begun > 0.0, past.variance, residual.variance)
    spread = decay**2 * before + (1.0 - decay**2) * residual.variance
    total = spread + residual.noise
    gain = seen * spread / total
    off = waves - decay * past.features
    off_y = y - decay * past.outputs
    weight = seen / total
    weighted = weight[:, None] * off
    count = jnp.asarray(past.count)
    return Past(
        past.gram + weighted[:, :, None] * off[:, None, :],
        past.product + weighted[group].T * off_y,
        past.squares + weight[group] * off_y**2,
        past.log_det + seen * jnp.log(total),
        count + seen,
        decay * past.features + gain[:, None] * off,
        decay * past.outputs + gain[group] * off_y,
        jnp.asarray((1.0 - gain) * spread),
        jnp.ones_like(jnp.asarray(past.begun)),
    )


def _both(
    rows: Rows, waves: Float[Array, "t f"], residual: Residual, of: Past
) -> Float[Array, "t g k"]:
    """Return waves and every group's outputs, less what the past makes of them."""
    columns = jnp.asarray(rows.columns)
    y = columns * jnp.asarray(rows.seen).T[:, :, None] * jnp.asarray(rows.y)[:, None, :]
    shape = (*y.shape[:2], waves.shape[1])
    z = jnp.concatenate([jnp.broadcast_to(waves[:, None, :], shape), y], axis=2)
    return z - _fading(residual, len(waves))[:, None, None] * _carried(of, columns)


def _carried(of: Past, columns: Float[Array, "g d"]) -> Float[Array, "g k"]:
    return jnp.concatenate([of.features, columns * of.outputs], axis=1)


def _fading(residual: Residual, rows: int) -> Float[Array, " t"]:
    """Return what is left of the past's state at every row."""
    return residual.decay ** jnp.arange(1.0, rows + 1.0)


def _gains(of: Past, seen: Float[Array, "g t"], residual: Residual) -> tuple[Array, Array, Array]:
    """Return gain, variance of the error, and variance of the residual then, (T, G) each."""
    decay, noise = residual.decay, residual.noise
    fresh = (1.0 - decay**2) * residual.variance

    def step(spread: Array, known: Array) -> tuple[Array, tuple[Array, Array, Array]]:
        spread = decay**2 * spread + fresh
        total = spread + noise
        gain = known * spread / total
        left = (1.0 - gain) * spread
        return left, (gain, total, left)

    first = jnp.where(of.begun > 0.0, of.variance, residual.variance)
    return jax.lax.scan(step, jnp.broadcast_to(first, seen.shape[:1]), seen.T)[1]


def _state(
    past: Past, rows: Rows, residual: Residual, found: _Filter, features: int
) -> tuple[Float[Array, "g f"], Float[Array, " d"], Float[Array, " g"]]:
    """Return the filter's state after the last frame."""
    last, columns = rows.filled - 1, jnp.asarray(rows.columns)
    fading = residual.decay ** (1.0 * rows.filled)
    learned = jnp.take(found.learned, last, axis=0)
    learned = learned + fading * _carried(past.split(rows.parent), columns)
    outputs = jnp.sum(columns * learned[:, features:], axis=0)
    return learned[:, :features], outputs, jnp.take(found.variance, last, axis=0)


def _misfit(
    followed: Followed, rows: Rows, known: Coefficients
) -> tuple[Float[Array, " d"], Float[Array, " d"], Float[Array, " d"]]:
    """Return misfit, log determinant and number of frames of every column."""
    columns = jnp.asarray(rows.columns)
    mean, squares = jnp.asarray(known.mean), followed.squares
    gram_mean = jnp.einsum("gij,jd,gd->id", followed.gram, mean, columns, optimize="optimal")
    rest = followed.product - gram_mean
    squares = squares - jnp.sum(mean * (followed.product + rest), axis=0)

    def one(gram: Array, root: Array, own: Array) -> tuple[Array, Array]:
        A = jnp.eye(gram.shape[0]) + root.T @ gram @ root
        return quadratic_logdet(A, root.T @ (rest * own), 0.0)

    explained, log_det = jax.vmap(one)(followed.gram, jnp.asarray(known.root), columns)
    of_columns = columns.T @ (log_det + followed.log_det)
    return squares - jnp.sum(explained, axis=0), of_columns, columns.T @ followed.count


def _posterior(
    followed: Followed, rows: Rows, known: Coefficients
) -> tuple[Float[Array, "f d"], Float[Array, "g f f"]]:
    """Return mean and covariance root of the coefficients given all frames."""
    mean, columns = jnp.asarray(known.mean), jnp.asarray(rows.columns)

    def one(gram: Array, root: Array, own: Array) -> tuple[Array, Array]:
        A = cholesky(jnp.eye(gram.shape[0]) + root.T @ gram @ root, 0.0)
        here = jax.scipy.linalg.solve_triangular(A, root.T, lower=True).T
        rest = (followed.product - gram @ mean) * own
        return here @ (here.T @ rest), here

    moved, root = jax.vmap(one)(followed.gram, jnp.asarray(known.root), columns)
    return mean + jnp.sum(moved, axis=0), root


__all__ = [
    "Ahead",
    "Coefficients",
    "Followed",
    "Past",
    "Residual",
    "Rows",
    "ahead",
    "follow",
    "gone",
    "log_density",
    "nothing",
]
