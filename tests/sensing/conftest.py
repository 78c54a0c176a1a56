"""A synthetic walker with cameras around her, and a synthetic talker."""

import pytest

from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.sensing.face.talker import synthetic_talker
from bayesmotion.sensing.voxels.cameras import circle


@pytest.fixture(scope="session")
def walker():
    return synthetic_walkers(["ann"], ["walk"], seconds=0.5, seed=3)


@pytest.fixture(scope="session")
def six():
    return circle(6)


@pytest.fixture(scope="session")
def talk():
    """Three short sentences of the synthetic talker."""
    return synthetic_talker(0, utterances=3, seconds=2.0, size=96)
