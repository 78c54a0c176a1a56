"""What the voxel study compares with and scores by, on numbers that are known."""

import numpy as np
import pytest

from bayesmotion.models.voxel_pose import VoxelPose
from bayesmotion.motion.synthetic.anthropometry import adult_skeleton
from bayesmotion.sensing.voxels.shape_context import ShapeContext
from bayesmotion.studies.voxel import report as voxel_report
from bayesmotion.studies.voxel import study as voxel
from bayesmotion.studies.voxel.data import (
    MOTIONS,
    OTHERS,
    SETUPS,
    TESTED,
    Seen,
    observe,
    picture_moments,
    reflected,
    together,
)
from bayesmotion.studies.voxel.models import (
    Nearest,
    Recognizer,
    Ridge,
    Scaled,
    coverage,
    errors,
    inputs_in_parts,
    inputs_of,
    means,
    parts,
)
from bayesmotion.studies.voxel.tests import speed


@pytest.fixture
def linear():
    """Angles that follow features nearly linearly."""
    random = np.random.default_rng(0)
    x = random.standard_normal((200, 5))
    angles = 0.1 * x @ random.standard_normal((5, 3)) + 0.003 * random.standard_normal((200, 3))
    return x, angles


def test_ridge_is_regression_with_a_penalty(linear):
    x, angles = linear
    ridge = Ridge.of(x[:150], angles[:150], list("abc"))
    # Nine tenths of the variance are regressed, and the rest is left.
    left = np.mean((ridge(x[150:]) - angles[150:]) ** 2) / angles.var()
    assert left < 0.15
    # Noise alone is not followed: the penalty is chosen to leave nearly nothing.
    noise = np.random.default_rng(1).standard_normal((150, 5))
    flat = Ridge.of(noise, angles[:150], list("abc"))
    assert flat(noise).std(axis=0).mean() < 0.3 * angles.std(axis=0).mean()


def test_nearest_gives_poses_that_trained(linear):
    x, angles = linear
    np.testing.assert_array_equal(Nearest(x, angles)(x[[3, 1]]), angles[[3, 1]])


def test_scores_are_those_of_the_definition():
    true = np.zeros((2, 2))
    found = np.radians([[3.0, 0.0], [4.0, 2.0]])
    spread = np.radians([[1.0, 1.0], [3.0, 1.0]])
    assert coverage(true, found, spread) == pytest.approx(2 / 4)
    # An angle that never moves counts neither way.
    still = [np.column_stack([one, [0.0, 0.0]]) for one in (true, found, spread)]
    assert coverage(*still) == pytest.approx(2 / 4)
    assert errors(true, {"one": found})["one"] == pytest.approx((np.sqrt(12.5) + np.sqrt(2.0)) / 2)
    table = parts(true, {"one": found}, ["root/heading", "lhumerus/rx"])
    assert table["heading"]["one"] == pytest.approx(np.sqrt(12.5))
    assert table["left_shoulder"]["one"] == pytest.approx(np.sqrt(2.0))
    assert "right_hip" not in table
    assert means({"a": {"m": 1.0}, "b": {"m": 2.0}}) == {"m": 1.5}
    scaled = Scaled.of(np.array([[1.0, 5.0], [3.0, 5.0]]))
    np.testing.assert_allclose(scaled(np.array([[2.0, 5.0]])), 0.0)


def test_moments_of_a_bar():
    picture = np.zeros((40, 50), dtype=bool)
    picture[5:25, 30:34] = True
    found = picture_moments(picture)
    # A bar of 20 by 4 pixels: variances (n^2 - 1) / 12 over the area 80, no third moments.
    np.testing.assert_allclose(found[:3], [15 / 12 / 80, 0.0, 399 / 12 / 80])
    np.testing.assert_allclose(found[3:7], 0.0, atol=1e-12)
    assert found[7] == 4 / 20
    np.testing.assert_allclose(picture_moments(np.roll(picture, 3, axis=0)), found)
    assert not picture_moments(np.zeros((4, 4), dtype=bool)).any()


def test_a_mirror_shows_what_the_cameras_would_see():
    """Moments of mirrored pictures, camera by camera, and voxels on the other side."""
    random = np.random.default_rng(3)
    cameras = 6
    pictures = random.random((cameras, 30, 40)) < 0.3
    labels = ("root/heading", "root/pitch", "root/roll", "lfemur/x", "rfemur/x")
    seen = Seen(
        np.array(["one"]), np.array([0]), labels, np.array([[0.1, 0.2, 0.3, 0.4, 0.5]]),
        np.array([[1, 2, 3]], dtype=np.int16), np.array([1]),
        np.concatenate([picture_moments(one) for one in pictures])[None], np.zeros(2),
    )  # fmt: skip
    other = reflected(seen)
    # The camera at 60 degrees sees what that at -60 does, the other way round.
    turned = [pictures[-i % cameras][:, ::-1] for i in range(cameras)]
    expected = np.concatenate([picture_moments(one) for one in turned])
    np.testing.assert_allclose(other.moments[0], expected, atol=1e-12)
    np.testing.assert_array_equal(other.voxels, [[-1, 2, 3]])
    np.testing.assert_allclose(other.angles, [[-0.1, 0.2, -0.3, 0.5, 0.4]])


def test_nobody_is_trained_and_tested_on_the_same_clip():
    train = [clip for chosen in MOTIONS.values() for clip in chosen.train]
    test = [clip for chosen in (*MOTIONS.values(), *OTHERS.values()) for clip in chosen.test]
    assert len(set(train) | set(test)) == len(train) + len(test)
    people = {clip.split("_")[0] for clip in train}
    assert not people & {c.split("_")[0] for chosen in OTHERS.values() for c in chosen.test}


def test_setups_differ():
    places = {name: [c.place.tolist() for c in SETUPS[name].cameras] for name in TESTED}
    assert places["six"] == places["noisy"]
    assert len({str(place) for place in places.values()}) == len(TESTED) - 1
    assert SETUPS["noisy"].noise is not None


def test_what_was_trained_is_read_back(tmp_path, monkeypatch):
    """The stages of the training on frames of random voxels, and again from their files."""
    small = VoxelPose(ShapeContext(2, 2, 3), cell=12, components=4, latent=1, mixture_points=400)
    monkeypatch.setattr(voxel, "SETTINGS", small)
    random = np.random.default_rng(0)
    counts = np.full(30, 200)
    body = random.integers(0, 20, (200, 3))
    moved = [(body * (1 + 0.3 * np.sin(i / 3) * np.eye(3)[1])).astype(np.int16) for i in range(30)]
    angles = 0.3 * np.sin(np.arange(30) / 3)[:, None] * np.ones(5)
    angles += 0.01 * random.standard_normal((30, 5))
    seen = Seen(
        np.full(30, "one"), np.arange(30), tuple("abcde"), angles, np.concatenate(moved), counts,
        random.standard_normal((30, 8)), np.ones(2),
    )  # fmt: skip
    found = []
    for _ in range(2):
        described = voxel._descriptors(seen, tmp_path / "descriptors.npz", lambda line: None)
        mixture, _ = voxel._mixture(
            lambda one=described: one, tmp_path / "mixture.npz", 0, lambda line: None
        )
        clusters = voxel._clusters(lambda one=described: one, tmp_path / "clusters.npz", 0)
        inputs = inputs_of(seen, described, mixture, clusters)
        part = inputs_in_parts(seen, small, mixture, clusters, frames=7)
        for whole, again in zip(inputs.parts, part.parts, strict=True):
            np.testing.assert_allclose(again, whole, atol=1e-6)
        regressor, _ = voxel._regressor(inputs.mppca, seen, tmp_path / "one.npz", lambda line: None)
        recognizer = Recognizer(small, mixture, regressor, adult_skeleton("one", 1.7), {}, 0.0)
        found.append(recognizer(described))
        assert speed({"turn": seen}, recognizer, frames=3)["voxels_to_pose"] > 0
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)
    assert np.abs(found[0][0] - angles).mean() < 0.1


@pytest.mark.real_data
def test_what_cameras_saw_comes_from_the_cache(data_root, tmp_path):
    seen = observe("16_35", 40, "four", data_root, tmp_path, 0)
    assert seen.angles.shape == (5, len(seen.labels))
    assert seen.moments.shape == (5, 32)
    assert [len(hull.shell) for hull in seen.hulls()] == seen.counts.tolist()
    again = observe("16_35", 40, "four", None, tmp_path, 0)
    np.testing.assert_array_equal(again.voxels, seen.voxels)
    fewer = observe("16_35", 40, "fewer", data_root, tmp_path, 0)
    six = observe("16_35", 40, "six", data_root, tmp_path, 0)
    # Fewer cameras carve less away; all six are seen.
    assert (fewer.counts > six.counts).mean() > 0.7
    np.testing.assert_array_equal(fewer.moments, six.moments)
    both = together([seen, again])
    assert len(both.counts) == 10
    assert len(both.voxels) == 2 * len(seen.voxels)


def test_the_report_shows_the_stages_there_are():
    models = ("rvm_mppca", "rvm_kmeans", "ridge", "nearest", "moments")
    row = dict.fromkeys(models, 4.0)
    result = {
        "motions": {"walk": row},
        "means": row,
        "motions_absolute": {"walk": dict.fromkeys(models, 3.0)},
        "motions_turned": {"walk": dict.fromkeys(models, 7.0)},
        "coverage90": {"walk": 0.91},
        "coverage90_mean": 0.91,
        "relevance_vectors": [30, 100],
        "frames": {"training": {"walk": 100}},
        "seconds": {"training": 120.0},
        "table1": {"full_body": row},
        "paper": {
            "table1": {"full_body": {"rvm_mppca": 5.2}},
            "motions": {"regular walk": 2.5},
            "relevance_vectors": [418, 1744],
        },
    }
    text = voxel_report.markdown(result)
    assert "| relevance vectors, mixture of PPCA | 4.00 | 4.00 |" in text
    assert "30 (30 %) are kept" in text
    assert "Frames a second" not in text
    result |= {"cameras": {"four": {"nearest": 6.0}}, "fps": {"voxels_to_pose": 33.3}}
    result |= {"curves": {"components": {"20": 5.0, "40": 4.0}}}
    text = voxel_report.markdown(result)
    assert "| four others |" in text
    assert "| voxels to pose | 33 |" in text
    assert "| degrees | 5.00 | 4.00 |" in text
