"""Bodies of ellipsoids against brute force and against rigid motion."""

import numpy as np
import pytest
import xarray as xr

from bayesmotion.errors import InputError
from bayesmotion.motion import Joint, Skeleton, make_motion, skeleton_of
from bayesmotion.motion.synthetic.anthropometry import adult_skeleton
from bayesmotion.sensing.voxels.body import body_of, pose_body


def still(skeleton, root=(0.0, 1.0, 0.0), **angles) -> xr.Dataset:
    angle = np.zeros((2, len(skeleton.dofs)))
    for dof, value in angles.items():
        angle[:, skeleton.dofs.index(dof.replace("__", "/"))] = value
    path = np.tile(np.array(root), (2, 1))
    return make_motion(skeleton, angle, path, frame_rate=30.0, clip="still")


def top(ellipsoids) -> float:
    reach = np.sqrt(ellipsoids.shape[0, :, 1, 1])
    return float((ellipsoids.centre[0, :, 1] + reach).max())


def test_the_body_fits_its_skeleton():
    skeleton = adult_skeleton("ann", 1.8)
    body = body_of(skeleton)
    ellipsoids = pose_body(body, still(skeleton))
    low = (ellipsoids.centre[0, :, 1] - np.sqrt(ellipsoids.shape[0, :, 1, 1])).min()
    assert 1.75 < top(ellipsoids) - low < 1.95
    # An ellipsoid along the left thigh is centred between hip and knee.
    thigh = body.names.index("lfemur")
    assert body.centre[thigh] @ body.centre[thigh] == pytest.approx((0.245 * 1.8 / 2) ** 2)
    along, across = body.shape[thigh, 1, 1], body.shape[thigh, 0, 0]
    assert along > (0.245 * 1.8 / 2) ** 2 > 4 * across


def test_the_body_turns_and_moves_with_the_root():
    skeleton = adult_skeleton("ann", 1.8)
    body = body_of(skeleton)
    one = pose_body(body, still(skeleton))
    other = pose_body(body, still(skeleton, root=(1.0, 1.0, 2.0), root__ry=np.pi / 2))
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    moved = (one.centre[0] - [0, 1, 0]) @ turn.T + [1, 1, 2]
    np.testing.assert_allclose(other.centre[0], moved, atol=1e-12)
    np.testing.assert_allclose(other.shape[0], turn @ one.shape[0] @ turn.T, atol=1e-12)


def test_a_bent_knee_moves_the_shank_and_nothing_else():
    skeleton = adult_skeleton("ann", 1.8)
    body = body_of(skeleton)
    change = (
        pose_body(body, still(skeleton, ltibia__rx=1.0)).centre
        - pose_body(body, still(skeleton)).centre
    )
    below = np.array([name in ("ltibia", "lfoot", "ltoes") for name in body.names])
    joint = np.array([np.allclose(c, 0) for c in body.centre]) & (np.array(body.names) == "ltibia")
    assert np.all(np.abs(change[0][~below | joint]) < 1e-12)
    assert np.all(np.linalg.norm(change[0][below & ~joint], axis=1) > 0.05)


def test_units_do_not_matter(walker):
    skeleton = skeleton_of(walker)
    centimetres = Skeleton(
        skeleton.name,
        tuple(
            Joint(j.name, j.parent, tuple(100 * np.array(j.offset)), j.axis, j.channels)
            for j in skeleton
        ),
        metres=0.01,
    )
    motion = make_motion(
        centimetres, walker["angle"].values, 100 * walker["root_position"].values,
        frame_rate=30.0, clip="walk",
    )  # fmt: skip
    one = pose_body(body_of(skeleton), walker)
    other = pose_body(body_of(centimetres), motion)
    np.testing.assert_allclose(one.centre, other.centre, atol=1e-9)
    np.testing.assert_allclose(one.shape, other.shape, atol=1e-9)


def test_a_skeleton_that_lies_is_refused():
    joints = (
        Joint("root", -1, (0.0, 0.0, 0.0), channels=("rz", "ry", "rx")),
        Joint("leg", 0, (1.0, 0.1, 0.0)),
    )
    with pytest.raises(InputError, match="does not stand upright"):
        body_of(Skeleton("flat", joints))


def test_a_motion_of_another_tree_is_refused(walker):
    joints = (
        Joint("root", -1, (0.0, 0.0, 0.0), channels=("rz", "ry", "rx")),
        Joint("spine", 0, (0.0, 1.0, 0.0)),
    )
    with pytest.raises(InputError, match="degrees of freedom"):
        pose_body(body_of(Skeleton("post", joints)), walker)
