"""What the covariance of every column is to be multiplied by."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import invgamma, multivariate_normal

from bayesmotion.errors import InputError
from bayesmotion.gp.matrix_normal import patterns, spread_of_columns
from bayesmotion.models.multifactor import Multifactor

N, D, FREEDOM = 5, 3, 6.0


@pytest.fixture
def process():
    random = np.random.default_rng(0)
    root = random.normal(size=(N, N))
    K, scale = root @ root.T + np.eye(N), np.array([0.5, 1.0, 3.0])
    y, loc = random.normal(size=(2, N, D))
    seen = np.ones((N, D), bool)
    seen[2:, 1] = False
    return K, scale, y, loc, seen


def test_what_it_learns_of_a_column_is_bayes_rule(process):
    K, scale, y, loc, seen = process
    shape, rate = spread_of_columns(y - loc, K, scale, FREEDOM, patterns(seen))
    for d in range(D):
        rows = seen[:, d]
        cov, r = K[np.ix_(rows, rows)] / scale[d] ** 2, (y - loc)[rows, d]

        def joint(size, cov=cov, r=r):
            prior = invgamma(FREEDOM / 2, scale=FREEDOM / 2).pdf(size)
            return prior * multivariate_normal(np.zeros(len(r)), size * cov).pdf(r)

        total = quad(joint, 0, np.inf)[0]
        mean = quad(lambda size: size * joint(size), 0, np.inf)[0] / total
        np.testing.assert_allclose(rate[d] / (shape[d] - 1.0), mean, rtol=1e-6)


def test_too_little_freedom_is_refused():
    with pytest.raises(InputError, match="number above two"):
        Multifactor(student_df=2.0)
