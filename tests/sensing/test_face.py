"""The appearance model and its search, on a talker whose landmarks are known."""

import numpy as np
import pytest
from skimage.transform import PiecewiseAffineTransform

from bayesmotion.errors import InputError
from bayesmotion.sensing.face.appearance import fit_appearance, principal
from bayesmotion.sensing.face.mesh import make_mesh, paint_texture, take_texture
from bayesmotion.sensing.face.procrustes import generalised_procrustes, inverse, moved, pose_to
from bayesmotion.sensing.face.search import train_search


def rms(error):
    """Root mean square distance of landmarks in pixels."""
    return float(np.sqrt((error**2).sum(axis=-1).mean()))


@pytest.fixture(scope="module")
def training(talk):
    frames = np.concatenate([one.frames for one in talk[:2]])
    return frames, np.concatenate([one.landmarks for one in talk[:2]])


@pytest.fixture(scope="module")
def model(training):
    return fit_appearance(*training)


@pytest.fixture(scope="module")
def search(model, training):
    frames, landmarks = training
    return train_search(model, frames[::2], landmarks[::2], seed=1, starts=6)


def test_procrustes_undoes_poses():
    random = np.random.default_rng(0)
    shape = random.normal(size=(7, 2)) * 20
    poses = random.normal(size=(5, 4)) * [1, 1, 30, 30]
    aligned, mean, back = generalised_procrustes(moved(np.broadcast_to(shape, (5, 7, 2)), poses))
    np.testing.assert_allclose(aligned, np.broadcast_to(mean, aligned.shape), atol=1e-8)
    np.testing.assert_allclose(
        moved(aligned, back), moved(np.broadcast_to(shape, (5, 7, 2)), poses), atol=1e-8
    )
    np.testing.assert_allclose(mean.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(pose_to(shape, moved(shape, poses[0])), poses[0], atol=1e-9)
    np.testing.assert_allclose(moved(moved(shape, poses[1]), inverse(poses[1])), shape, atol=1e-9)


def test_no_pose_brings_shapes_closer_than_procrustes(talk):
    random = np.random.default_rng(1)
    shape, target = talk[0].landmarks[0], talk[0].landmarks[10]
    best = pose_to(shape, target)
    least = ((moved(shape, best) - target) ** 2).sum()
    for _ in range(50):
        other = best + random.normal(size=4) * [1e-3, 1e-3, 0.1, 0.1]
        assert ((moved(shape, other) - target) ** 2).sum() > least


def test_the_warp_is_the_piecewise_affine_one(talk):
    """Against scikit-image's transform of the same landmarks."""
    mesh = make_mesh(talk[0].landmarks[0])
    shape = talk[0].landmarks[8]
    picture = np.indices((96, 96)).transpose(1, 2, 0)[..., ::-1].astype(float)  # x, y themselves
    other = PiecewiseAffineTransform.from_estimate(mesh.reference, shape)
    found = take_texture(mesh, picture, shape)
    np.testing.assert_allclose(found, other(mesh.pixels[:, ::-1].astype(float)), atol=1e-6)


def test_a_texture_is_painted_where_it_was_taken(talk):
    picture = talk[0].frames[4].astype(float)
    shape = talk[0].landmarks[4]
    mesh = make_mesh(shape, scale=2.0)
    painted = paint_texture(mesh, take_texture(mesh, picture, shape), shape, np.zeros_like(picture))
    inside = painted.any(axis=-1)
    assert inside.sum() == pytest.approx(len(mesh.pixels) / 4, rel=0.05)
    assert np.abs(painted - picture)[inside].mean() < 1.5
    # Without holes between the triangles.
    rows = [np.flatnonzero(row) for row in inside if row.any()]
    assert all(np.ptp(row) + 1 == len(row) for row in rows[8:-2])


def test_the_model_keeps_95_percent_of_the_variance_each_time(model, training):
    frames, landmarks = training
    assert min(model.kept) >= 0.95
    aligned = generalised_procrustes(landmarks)[0].reshape(len(frames), -1)
    textures = model.textures(frames, landmarks)
    for rows, basis in ((aligned, model.shape_basis), (textures, model.texture_basis)):
        centred = rows - rows.mean(axis=0)
        np.testing.assert_allclose(basis.T @ basis, np.eye(basis.shape[1]), atol=1e-8)
        kept = ((centred @ basis) ** 2).sum() / (centred**2).sum()
        fewer = ((centred @ basis[:, :-1]) ** 2).sum() / (centred**2).sum()
        assert fewer < 0.95 <= kept


def test_the_components_are_the_same_from_either_matrix():
    rows = np.random.default_rng(2).normal(size=(30, 8)) * np.arange(1, 9)
    rows -= rows.mean(axis=0)
    narrow, share = principal(rows, 0.9)
    wide, same = principal(np.hstack([rows, np.zeros((30, 40))]), 0.9)
    assert share == pytest.approx(same)
    np.testing.assert_allclose(narrow @ narrow.T, (wide @ wide.T)[:8, :8], atol=1e-8)


def test_a_held_out_frame_is_reconstructed(model, talk):
    frames, landmarks = talk[2].frames, talk[2].landmarks
    parameters = model.encode(frames, landmarks)
    shapes, textures = model.decode(parameters)
    poses = model.poses(landmarks)
    still = np.broadcast_to(model.mean_shape, shapes.shape)
    moves = rms(moved(still, poses) - landmarks)
    assert rms(model.landmarks(parameters, poses) - landmarks) < 0.4 * moves
    taken = model.textures(frames, landmarks)
    changes = np.sqrt(np.mean((taken - model.mean_texture) ** 2))
    # The camera's noise of two grey levels is no part of the face.
    left = np.sqrt(max(np.mean((taken - textures) ** 2) - 4.0, 0.0))
    assert left < 0.5 * changes
    painted = model.render(parameters[:5], poses[:5], np.zeros((96, 96, 3)))
    inside = painted.any(axis=-1)
    error = np.abs(painted - frames[:5])[inside].mean()
    other = np.abs(painted - frames[10:15])[inside].mean()
    assert error < 6.0
    assert error < 0.6 * other


def test_a_person_at_rest_has_parameters_zero(training):
    """Two people: means of their own, and what changes within each of them."""
    frames, landmarks = training
    darker = np.concatenate([frames, frames // 2])
    wider = np.concatenate([landmarks, landmarks])
    names = ["ann"] * len(frames) + ["bob"] * len(frames)
    both = fit_appearance(darker, wider, person=names)
    bob = both.of(frames // 2, landmarks)
    assert np.abs(bob.encode(frames // 2, landmarks).mean(axis=0)).max() < 0.05 * both.spread.max()
    together = fit_appearance(darker, wider)
    # Without names the difference between the two takes the first component.
    assert together.spread[0] > 3 * both.spread[0]


@pytest.mark.parametrize("far", [0.0, 4.0, 8.0])
def test_the_search_finds_landmarks_displaced_by_up_to_eight_pixels(search, talk, far):
    errors = []
    for number in (0, 15, 30, 45):
        for towards in np.arange(4) * np.pi / 2 + number:
            start = talk[2].landmarks[number] + far * np.array([np.cos(towards), np.sin(towards)])
            found = search(talk[2].frames[number], start)
            assert not found.failure
            errors.append(rms(found.landmarks - talk[2].landmarks[number]))
    assert max(errors) < 0.7
    assert np.mean(errors) < 0.3


def test_a_face_is_tracked_through_a_video(search, talk):
    found = search.track(talk[2].frames, talk[2].landmarks[0] + 5.0)
    errors = [rms(a.landmarks - b) for a, b in zip(found, talk[2].landmarks, strict=True)]
    assert max(errors) < 1.0


def test_a_search_that_fails_says_so(search, talk):
    found = search(talk[2].frames[0], talk[2].landmarks[0] + 40.0)
    assert "grey levels away" in found.failure
    assert rms(found.landmarks - talk[2].landmarks[0]) > 5.0


def test_grey_pictures_work_too(training, talk):
    frames, landmarks = training
    model = fit_appearance(frames[::2, :, :, 0], landmarks[::2])
    assert model.channels == 1
    parameters = model.encode(talk[2].frames[:2, :, :, 0], talk[2].landmarks[:2])
    poses = model.poses(talk[2].landmarks[:2])
    painted = model.render(parameters, poses, np.zeros((96, 96)))
    assert painted.shape == (2, 96, 96, 1)
    with pytest.raises(InputError, match="1 channels"):
        model.encode(talk[2].frames[:2], talk[2].landmarks[:2])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f, m: (f[:0], m[:0]), "there are 0"),
        (lambda f, m: (f[:3], np.full_like(m[:3], np.nan)), "3 pictures have"),
        (lambda f, m: (f[[1, 1]], m[[1, 1]]), "nothing changes"),
        (lambda f, m: (f[:3, ..., :2], m[:3]), "grey or colour"),
        (lambda f, m: (f[:3], m[:3] * [1.0, 0.0]), "on a line"),
        (lambda f, m: (f[:3], m[:3] * 0.0), "in one point"),
    ],
)
def test_pictures_that_make_no_model_are_told(training, change, message):
    with pytest.raises(InputError, match=message):
        fit_appearance(*change(*training))
