"""A synthetic walker, and cameras around her."""

import pytest

from bayesmotion.motion.synthetic import synthetic_walkers
from bayesmotion.sensing.cameras import circle


@pytest.fixture(scope="session")
def walker():
    return synthetic_walkers(["ann"], ["walk"], seconds=0.5, seed=3)


@pytest.fixture(scope="session")
def six():
    return circle(6)
