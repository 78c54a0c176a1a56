"""Whether ranks are uniform: the simultaneous band of their ECDF.

Of n ranks r_i in 0..L, when every value is equally probable, the number below k is

    C_k = #{r_i < k} ~ Binomial(n, k / (L + 1)),    k = 1..L.

The statistic is the smallest tail probability over all k (Sailynoja, Burkner and
Vehtari 2022),

    g = min_k min(P(C <= C_k), P(C >= C_k)),

whose distribution under uniformity is simulated. The p-value of ranks is the share of
uniform ones with a g as small; the band that contains the whole ECDF of uniform ranks
with probability 1 - a is that of all counts with tails above the a-quantile of g.
"""

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import binom

REPEATS = 20_000


def p_value(ranks: Int[np.ndarray, " n"], levels: int) -> float:
    """Give the probability that uniform ranks in 0..levels-1 are as far from uniform as these.

    The smallest that can be told is one over `REPEATS`.
    """
    null = _null(len(ranks), levels)
    found = _smallest_tail(_counts(ranks[None], levels), len(ranks), levels)[0]
    # Equal counts give tails that differ by rounding.
    as_far = np.count_nonzero(null <= found * (1.0 + 1e-9))
    return float((as_far + 1) / (len(null) + 1))


def band(n: int, levels: int, probability: float = 0.95) -> Float[np.ndarray, "k 2"]:
    """Give the lowest and highest share of n ranks below k, for k = 0..levels.

    The ECDF of uniform ranks stays inside everywhere with the given probability.
    """
    tail = float(np.quantile(_null(n, levels), 1.0 - probability))
    at = np.arange(levels + 1) / levels
    low = binom.ppf(tail, n, at)
    high = binom.isf(tail, n, at)
    low[0] = high[0] = 0.0
    return np.stack([low, high], axis=1) / n


def ecdf(ranks: Int[np.ndarray, " n"], levels: int) -> Float[np.ndarray, " k"]:
    """Give the share of ranks below k, for k = 0..levels."""
    below = _counts(ranks[None], levels)[0] / len(ranks)
    return np.concatenate([[0.0], below, [1.0]])


def _counts(ranks: Int[np.ndarray, "m n"], levels: int) -> Int[np.ndarray, "m k"]:
    """Count the ranks below k = 1..levels-1 in every row."""
    rows = np.arange(len(ranks))[:, None]
    cells = np.bincount((rows * levels + ranks).ravel(), minlength=len(ranks) * levels)
    return np.cumsum(cells.reshape(len(ranks), levels), axis=1)[:, :-1]


def _smallest_tail(counts: Int[np.ndarray, "m k"], n: int, levels: int) -> Float[np.ndarray, " m"]:
    """Give g for every row of counts."""
    return _tails(n, levels)[counts, np.arange(levels - 1)].min(axis=1)


@lru_cache
def _tails(n: int, levels: int) -> Float[np.ndarray, "c k"]:
    """Give the smaller tail of every count 0..n, for k = 1..levels-1."""
    at = np.arange(1, levels) / levels
    counts = np.arange(n + 1)[:, None]
    return np.minimum(binom.cdf(counts, n, at), binom.sf(counts - 1, n, at))


@lru_cache
def _null(n: int, levels: int) -> Float[np.ndarray, " m"]:
    """Simulate g for uniform ranks; the same n and number of levels give the same."""
    random = np.random.default_rng(n * 1_000_003 + levels)
    blocks = [random.integers(levels, size=(REPEATS // 20, n)) for _ in range(20)]
    return np.concatenate([_smallest_tail(_counts(b, levels), n, levels) for b in blocks])
