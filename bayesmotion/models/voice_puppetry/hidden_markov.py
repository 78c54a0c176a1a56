"""Hidden Markov chains of several clips: recursions in logarithms, and the outputs' density.

States s_t of every clip begin anew and go by a transition matrix A; every frame has an output
normal given its state. Rows of outputs that miss the same entries share a pattern, and what
is missing is marginalised entry by entry.

With e_t(s) = log p(y_t | s), the recursions give of every frame the state's probabilities
given the frames before it, given those after it, and given all.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import logsumexp
from jaxtyping import Array, Bool, Float, Int
from numpyro import distributions as dist
from numpyro.distributions import constraints

from ...gp.linalg import AnyArray, cholesky, inverse_factor
from ...gp.matrix_normal import LOG_2PI, masked

TINY = 1e-300


class Rows(NamedTuple):
    """Which entries of every row are seen.

    seen
        (P, D), 1 where the pattern's rows have the entry, else 0.
    which
        (N,) pattern of every row.
    """

    seen: Float[AnyArray, "p d"]
    which: Int[AnyArray, " n"]


class Chain(NamedTuple):
    """Log probabilities of the first state and of transitions, and where clips begin."""

    initial: Float[AnyArray, " k"]
    transition: Float[AnyArray, "k k"]
    begins: Bool[AnyArray, " n"]


class Recursions(NamedTuple):
    """What forward and backward recursions give, all in logarithms.

    before, filtered
        (N, K) of every frame's states given the frames before it; and it as well.
    after
        (N, K) log p(frames after it | state), up to a constant a frame.
    frame
        (N,) log p(y_t | frames before it).
    """

    before: Float[Array, "n k"]
    filtered: Float[Array, "n k"]
    after: Float[Array, "n k"]
    frame: Float[Array, " n"]

    @property
    def posterior(self) -> Float[Array, "n k"]:
        """Log probabilities of every frame's states given all frames."""
        both = self.filtered + self.after
        return both - logsumexp(both, axis=1, keepdims=True)

    def left_out(self, emission: Float[AnyArray, "n k"]) -> Float[Array, " n"]:
        """Return log p(y_t | all other frames)."""
        others = self.before + self.after
        return logsumexp(others + emission, axis=1) - logsumexp(others, axis=1)


def row_patterns(seen: Bool[np.ndarray, "n d"]) -> Rows:
    """Group rows by the entries that are seen."""
    patterns, which = np.unique(seen, axis=0, return_inverse=True)
    return Rows(patterns.astype(float), which.ravel())


def chain(initial: AnyArray, transition: AnyArray, begins: AnyArray) -> Chain:
    """Return the chain of probabilities; those of zero are as good as zero."""
    first, moves = (jnp.log(jnp.maximum(jnp.asarray(p), TINY)) for p in (initial, transition))
    return Chain(first, moves, begins)


def forward(chain: Chain, emission: Float[AnyArray, "n k"]) -> tuple[Array, Array, Array]:
    """Return `Recursions`' before, filtered and frame."""

    def step(filtered: Array, now: tuple) -> tuple:
        begin, e = now
        moved = logsumexp(filtered[:, None] + chain.transition, axis=0)
        before = jnp.where(begin, chain.initial, moved)
        frame = logsumexp(before + e)
        here = before + e - frame
        return here, (before, here, frame)

    return jax.lax.scan(step, jnp.asarray(chain.initial), (chain.begins, emission))[1]


def log_likelihood(chain: Chain, emission: Float[AnyArray, "n k"]) -> Float[Array, ""]:
    """Return log p(all frames)."""
    return jnp.sum(forward(chain, emission)[2])


def recursions(chain: Chain, emission: Float[AnyArray, "n k"]) -> Recursions:
    """Run forward and backward."""
    before, filtered, frame = forward(chain, emission)

    def step(carried: Array, now: tuple) -> tuple:
        begin, e, norm = now
        back = logsumexp(chain.transition + (e + carried)[None], axis=1) - norm
        return jnp.where(begin, 0.0, back), carried

    last = jnp.zeros_like(chain.initial)
    every = (jnp.asarray(chain.begins), jnp.asarray(emission), frame)
    after = jax.lax.scan(step, last, every, reverse=True)[1]
    return Recursions(before, filtered, after, frame)


def draw_path(key: Array, chain: Chain, filtered: Float[AnyArray, "n k"]) -> Int[Array, " n"]:
    """Draw a path of states given all frames, from the last frame back."""
    begins_next = jnp.append(jnp.asarray(chain.begins)[1:], True)

    def step(following: Array, now: tuple) -> tuple:
        key, here, cut = now
        logits = jnp.where(cut, here, here + chain.transition[:, following])
        state = jax.random.categorical(key, logits)
        return state, state

    keys = jax.random.split(key, len(begins_next))
    every = (keys, jnp.asarray(filtered), begins_next)
    return jax.lax.scan(step, jnp.zeros((), int), every, reverse=True)[1]


def log_emissions(
    mean: Float[AnyArray, "k d"],
    precision: Float[AnyArray, "k d d"],
    y: Float[AnyArray, "n d"],
    rows: Rows,
) -> Float[Array, "n k"]:
    """Return the log density of every row's seen entries under every state."""
    covariance = jnp.linalg.inv(jnp.asarray(precision))
    seen_rows, which = jnp.asarray(rows.seen), jnp.asarray(rows.which)

    def one(pattern: tuple) -> Array:
        seen, index = pattern
        inverse = jax.vmap(lambda c: inverse_factor(cholesky(masked(c, seen))))(covariance)
        logdet = jnp.sum(jnp.log(jnp.diagonal(inverse, axis1=1, axis2=2)), axis=1)
        away = jnp.where(seen > 0, y, 0.0)[:, None] - seen * jnp.asarray(mean)
        white = jnp.einsum("kde,nke->nkd", inverse, away)
        density = logdet - 0.5 * (jnp.sum(white**2, axis=2) + jnp.sum(seen) * LOG_2PI)
        return jnp.where((which == index)[:, None], density, 0.0)

    return _summed(one, (seen_rows, jnp.arange(len(seen_rows))))


def fill(
    mean: Float[AnyArray, "k d"],
    precision: Float[AnyArray, "k d d"],
    y: Float[AnyArray, "n d"],
    rows: Rows,
) -> tuple[Float[Array, "n k d"], Float[Array, "p k d d"]]:
    """Return every row with what it misses at its mean under every state, given what it has.

    Beside it (P, K, D, D) the covariance of what is missing, zero elsewhere.
    """
    precision, mean = jnp.asarray(precision), jnp.asarray(mean)
    seen_rows, which = jnp.asarray(rows.seen), jnp.asarray(rows.which)

    def one(pattern: tuple) -> Array:
        seen, index = pattern
        away = jnp.where(seen > 0, y, 0.0)[:, None] - seen * mean
        pulled = jnp.einsum("kde,nke->nkd", precision, away)
        moved = mean - jnp.einsum("kde,nke->nkd", _left(precision, seen), pulled)
        found = jnp.where(seen > 0, jnp.where(seen > 0, y, 0.0)[:, None], moved)
        return jnp.where((which == index)[:, None, None], found, 0.0)

    filled = _summed(one, (seen_rows, jnp.arange(len(seen_rows))))
    return filled, jax.lax.map(lambda seen: _left(precision, seen), seen_rows)


def _left(precision: Array, seen: Array) -> Array:
    """Return the covariance (K, D, D) of what is not seen given what is."""
    missing = 1.0 - seen
    inverse = jnp.linalg.inv(jax.vmap(lambda p: masked(p, missing))(precision))
    return missing[:, None] * missing[None, :] * inverse


def _summed(one, patterns: tuple) -> Array:
    """Add up what patterns give, one after another."""
    first = one(jax.tree.map(lambda part: part[0], patterns))
    rest = jax.tree.map(lambda part: part[1:], patterns)
    return jax.lax.scan(lambda total, p: (total + one(p), None), first, rest)[0]


class Outputs(dist.Distribution):
    """The distribution of outputs Y (N, D) of a chain, given other outputs of its states.

    Parameters
    ----------
    chain
        The chain.
    known
        (N, K) log density of the other outputs under every state; zero where there are none.
    mean, precision
        (K, D) and (K, D, D) of every state's normal.
    rows
        Which entries are seen; the others count for nothing.
    """

    support = constraints.real_matrix  # pyright: ignore[reportAssignmentType]  NumPyro's own way
    pytree_data_fields = ("chain", "known", "mean_", "precision", "rows")

    def __init__(self, chain, known, mean, precision, rows, *, validate_args=None):
        self.chain, self.known = chain, known
        self.mean_, self.precision, self.rows = mean, precision, rows
        shape = (known.shape[0], mean.shape[1])
        super().__init__(batch_shape=(), event_shape=shape, validate_args=False)

    def log_prob(self, value):
        """Log density of the seen entries of `value` (N, D) given the other outputs."""
        own = log_emissions(self.mean_, self.precision, value, self.rows)
        both = log_likelihood(self.chain, self.known + own)
        return both - log_likelihood(self.chain, self.known)

    def sample(self, key=None, sample_shape=()):
        """Draw outputs: a path of states given the other outputs, then a normal a frame."""
        assert key is not None, "a draw needs a key"
        filtered = forward(self.chain, self.known)[1]
        roots = jax.vmap(lambda p: inverse_factor(cholesky(p)).T)(self.precision)

        def one(key):
            path_key, white_key = jax.random.split(key)
            path = draw_path(path_key, self.chain, filtered)
            white = jax.random.normal(white_key, self.event_shape)
            return self.mean_[path] + jnp.einsum("nde,ne->nd", roots[path], white)

        for _ in sample_shape:
            one = jax.vmap(one)
        return one(jax.random.split(key, sample_shape) if sample_shape else key)
