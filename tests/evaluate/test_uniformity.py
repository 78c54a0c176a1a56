"""Tests of uniform ranks: against every outcome of a tiny problem, and in the long run."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import binom, kstest

from bayesmotion.evaluate.sbc.uniformity import band, ecdf, p_value


def test_the_p_value_is_the_share_of_all_outcomes_that_stray_as_far():
    n, levels = 4, 3

    def smallest_tail(ranks) -> float:
        tails = []
        for k in range(1, levels):
            below, at = np.count_nonzero(np.array(ranks) < k), k / levels
            tails += [binom.cdf(below, n, at), binom.sf(below - 1, n, at)]
        return min(tails)

    every = [smallest_tail(ranks) for ranks in product(range(levels), repeat=n)]
    for ranks in ([0, 0, 0, 0], [0, 0, 0, 1], [0, 1, 1, 2]):
        exact = np.mean(np.array(every) <= smallest_tail(ranks) + 1e-12)
        error = np.sqrt(exact * (1.0 - exact) / 20_000)
        assert p_value(np.array(ranks), levels) == pytest.approx(exact, abs=4 * error + 1e-4)


def test_the_band_holds_the_ecdf_as_often_as_it_says():
    random = np.random.default_rng(0)
    n, levels, repeats = 100, 51, 400
    allowed = band(n, levels)
    inside, p = [], []
    for _ in range(repeats):
        ranks = random.integers(levels, size=n)
        curve = ecdf(ranks, levels)
        inside.append(np.all((curve >= allowed[:, 0] - 1e-9) & (curve <= allowed[:, 1] + 1e-9)))
        p.append(p_value(ranks, levels))
        # The two ways to say it agree, but for ties at the edge.
        assert inside[-1] == (p[-1] > 0.05) or abs(p[-1] - 0.05) < 0.01
    share = np.mean(inside)
    assert abs(share - 0.95) < 4 * np.sqrt(0.95 * 0.05 / repeats) + 0.005
    assert kstest(p, "uniform").pvalue > 1e-3


@pytest.mark.parametrize("power", [0.6, 1.6])
def test_ranks_that_lean_or_crowd_are_caught(power):
    random = np.random.default_rng(1)
    leaning = random.uniform(size=200) ** power
    assert p_value((51 * leaning).astype(int), 51) < 1e-3
    crowded = 0.5 + 0.5 * np.sign(leaning - 0.5) * np.abs(2 * leaning - 1) ** 1.6
    assert p_value((51 * crowded).astype(int), 51) < 1e-3
