"""A small torus sampled by NUTS: draws of a model whose mode the other tests look at."""

import numpy as np
import pytest

from bayesmotion.inference.nuts import fit_nuts
from bayesmotion.models.gait_pose import GaitPose
from bayesmotion.motion.cycles import cycles_of
from bayesmotion.motion.synthetic import synthetic_walkers


@pytest.mark.slow
def test_a_small_surface_can_be_sampled():
    walks = synthetic_walkers(("ann", "ben", "cas"), ("walk",), seconds=2.6, styles=2)
    cycles = cycles_of(walks, 1, poses=6)
    fit = fit_nuts(
        GaitPose("torus", sigma=0.1), cycles, seed=0, warmup=60, draws=40, chains=2,
        mass="diagonal", max_tree_depth=6,
    )  # fmt: skip
    posterior = fit.tree["posterior"]
    assert posterior["x"].shape == (2, 40, 18, 3)
    # What data can tell agrees between chains: the noise, and distances of latent points in
    # the kernel's unit.
    gamma = posterior["gamma"].values
    x = posterior["x"].values
    apart = np.linalg.norm(x[:, :, 0] - x[:, :, 3], axis=-1) * np.sqrt(gamma)
    for values in (np.log(posterior["beta"].values), apart):
        spread = values.std(axis=1).mean()
        assert abs(values[0].mean() - values[1].mean()) < 4.0 * spread
    assert int(fit.tree["sample_stats"]["diverging"].values.sum()) < 8
