"""From voxels to poses on a synthetic walker: everything small."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.models.clusters import find_clusters
from bayesmotion.models.joint_angles import angle_labels, angles_of, rms_degrees
from bayesmotion.motion import skeleton_of
from bayesmotion.motion.synthetic import synthetic_walkers
from bayesmotion.sensing.cameras import circle
from bayesmotion.sensing.shape_context import ShapeContext
from bayesmotion.sensing.voxels import Hull, carve, hulls
from bayesmotion.studies.voxel_models import coverage
from bayesmotion.tasks.voxel_features import Descriptors, describe, features, joined, rooted
from bayesmotion.tasks.voxel_files import (
    load_regressor,
    load_voxel_pose,
    save_regressor,
    save_voxel_pose,
)
from bayesmotion.tasks.voxel_pose import Settings, median_distance, train, train_regressor

SMALL = Settings(
    ShapeContext(3, 4, 6), cell=5, components=12, latent=3, points=3000, mixture_steps=6
)


@pytest.fixture(scope="module")
def seen():
    """Two takes of a walk, the second with other noise on the angles, as descriptors."""
    found = []
    for noise in (0.01, 0.011):
        walk = synthetic_walkers(["ann"], ["walk"], seconds=2.0, seed=1, noise=noise)
        labels = angle_labels(skeleton_of(walk))
        voxels = carve(walk, circle(5), seed=0)
        described = describe(hulls(voxels), SMALL.context, SMALL.cell)
        found.append((described, angles_of(walk, labels), labels, skeleton_of(walk)))
    return found


@pytest.fixture(scope="module")
def fitted(seen):
    described, angles, labels, skeleton = seen[0]
    return train(
        described, angles, labels, SMALL, seed=0, skeleton=skeleton, rest={"lowerback/rx": 0.1}
    )


def test_poses_are_recognised(seen, fitted):
    described, angles, _, _ = seen[1]
    found, spread = fitted.recognise(described)
    still = np.broadcast_to(angles.mean(axis=0), angles.shape)
    error = rms_degrees(angles, found)
    assert error < 0.6 * rms_degrees(angles, still)
    assert coverage(angles, found, spread) > 0.7
    # A knee turns about one axis: two of its angles stay, and nothing is unsure of them.
    moves = angles.std(axis=0) > 1e-4
    assert 20 < moves.sum() < 42
    assert (spread[:, moves] > 0).all()


def test_a_fit_comes_back_from_its_file(seen, fitted, tmp_path):
    save_voxel_pose(fitted, tmp_path / "fit.nc")
    again = load_voxel_pose(tmp_path / "fit.nc")
    for one, other in zip(fitted.recognise(seen[1][0]), again.recognise(seen[1][0]), strict=True):
        np.testing.assert_array_equal(one, other)
    assert again.settings == fitted.settings
    assert (again.rest, again.seed, again.seconds) == (fitted.rest, fitted.seed, fitted.seconds)
    assert again.skeleton == fitted.skeleton
    save_regressor(fitted.regressor, tmp_path / "regressor.nc")
    x = rooted(features(seen[1][0], fitted.mixture))
    alone = load_regressor(tmp_path / "regressor.nc")
    np.testing.assert_array_equal(alone(x)[0], fitted.regressor(x)[0])
    with pytest.raises(InputError, match="no such file"):
        load_voxel_pose(tmp_path / "none.nc")
    with pytest.raises(InputError, match="no fit from voxels"):
        load_voxel_pose(tmp_path / "regressor.nc")


def test_the_length_is_that_which_does_best_where_held_out():
    """A wiggle that only a short kernel follows, a slope that a long one follows better."""
    random = np.random.default_rng(0)
    x = random.uniform(-1, 1, (240, 2))
    slow = np.column_stack([0.5 * x[:, 0], 0.3 * x[:, 1]])
    fast = np.column_stack([0.5 * np.sin(9 * x[:, 0]), 0.3 * np.cos(9 * x[:, 1])])
    scales = []
    for angles in (slow, fast):
        noisy = angles + 0.02 * random.standard_normal(angles.shape)
        found = train_regressor(x, noisy, ["a", "b"], Settings(share=0.99))
        scales.append(found.length_scale)
        new = random.uniform(-0.9, 0.9, (200, 2))
        z, variance = found.outputs(new)
        # Predictions are never surer than they were right on frames held out.
        assert (variance >= found.held_out).all()
        assert z.shape == (200, len(found.held_out))
    assert scales[1] < scales[0]
    fixed = train_regressor(x, slow, ["a", "b"], Settings(share=0.99, length_scale=2.0))
    assert fixed.length_scale == pytest.approx(2.0 * median_distance(x))
    # With fewer candidates every third frame, and the constant, may be kept.
    few = train_regressor(
        x, slow, ["a", "b"], Settings(share=0.99, length_scale=2.0, candidates=80)
    )
    rows = {tuple(row) for row in x[::3]}
    constant = np.isnan(few.vectors[:, 0])
    assert {tuple(row) for row in few.vectors[~constant]} <= rows
    assert rms_degrees(slow, few(x)[0]) < 0.3 * np.degrees(slow.std(axis=0).mean())


def test_features_are_means_of_responsibilities(seen, fitted):
    described = seen[0][0]
    x = features(described, fitted.mixture)
    np.testing.assert_allclose(x.sum(axis=1), 1.0, rtol=1e-5)
    first = fitted.mixture.responsibilities(described.values[: described.counts[0]])
    np.testing.assert_allclose(x[0], first.mean(axis=0), rtol=1e-5)
    clusters = find_clusters(described.values, 7, seed=0)
    votes = features(described, clusters)
    assert votes.shape == (len(described.counts), 7)
    last = clusters.votes(described.values[-described.counts[-1] :])
    np.testing.assert_allclose(votes[-1], last.mean(axis=0), rtol=1e-5)


def test_descriptors_are_drawn_and_joined(seen):
    one, other = seen[0][0], seen[1][0]
    both = joined([one, other])
    assert len(both.values) == both.counts.sum() == len(one.values) + len(other.values)
    drawn = both.sample(50, seed=0)
    assert drawn.shape == (50, SMALL.context.bins)
    assert len(np.unique(drawn, axis=0)) > 45
    assert both.sample(10**6, seed=0) is both.values


def test_what_makes_no_sense_is_refused(seen):
    described, angles, labels, skeleton = seen[0]
    with pytest.raises(InputError, match="poses for"):
        train(described, angles[:-1], labels, SMALL, seed=0, skeleton=skeleton, rest={})
    with pytest.raises(InputError, match="there are no frames"):
        describe([], SMALL.context)
    nothing = Hull(np.zeros((0, 3), dtype=int), np.zeros(0, dtype=bool))
    with pytest.raises(InputError, match="frame 0: it has no voxels"):
        describe([nothing], SMALL.context)
    assert isinstance(described, Descriptors)
