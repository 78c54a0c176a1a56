"""Forward kinematics: derivatives, compilation, and agreement with pybvh."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pybvh
import pytest

from bayesmotion.motion import (
    Joint,
    Skeleton,
    concat,
    forward,
    make_motion,
    positions,
    read_amc,
    read_bvh,
    rotations,
    skeleton_of,
)

ahead = jax.jit(forward, static_argnums=0)
turned_by = jax.jit(rotations, static_argnums=0)

# Joints that sit where the BVH release has them; those above the thorax do not.
BELOW_THORAX = {
    "root": "Hips",
    "lfemur": "LeftUpLeg",
    "ltibia": "LeftLeg",
    "lfoot": "LeftFoot",
    "ltoes": "LeftToeBase",
    "ltoes_end": "LeftToeBase_end",
    "rfoot": "RightFoot",
    "rtoes_end": "RightToeBase_end",
    "lowerback": "LowerBack",
    "upperback": "Spine",
    "thorax": "Spine1",
}
ABOVE_THORAX = {
    "lowerneck": "Neck",
    "upperneck": "Neck1",
    "head": "Head",
    "head_end": "Head_end",
    "lclavicle": "LeftShoulder",
    "lhumerus": "LeftArm",
    "lradius": "LeftForeArm",
    "rradius": "RightForeArm",
}


def test_rest_pose_adds_up_offsets(skeleton: Skeleton):
    where = np.asarray(ahead(skeleton, np.zeros(len(skeleton.dofs)), np.array([1.0, 2.0, 3.0])))
    expected = np.zeros((len(skeleton), 3))
    for index, joint in enumerate(skeleton):
        above = np.array([1.0, 2.0, 3.0]) if index == 0 else expected[joint.parent]
        expected[index] = above + joint.offset
    np.testing.assert_allclose(where, expected, atol=1e-12)
    turned = turned_by(skeleton, np.zeros(len(skeleton.dofs)))
    np.testing.assert_allclose(turned, np.broadcast_to(np.eye(3), turned.shape), atol=1e-12)


def test_rotations_are_rotations(skeleton: Skeleton, make):
    turned = np.asarray(turned_by(skeleton, make()["angle"].values))
    product = turned @ np.swapaxes(turned, -1, -2)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), turned.shape), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turned), 1.0, atol=1e-12)


def test_channels_are_multiplied_from_left_to_right():
    body = Skeleton(
        "arm",
        (
            Joint("root", -1, (0.0, 0.0, 0.0), channels=("ry", "rz")),
            Joint("tip", 0, (1.0, 0.0, 0.0)),
        ),
    )
    # Rz first takes x to y, which Ry leaves alone; the other way round it would be -z.
    where = ahead(body, np.array([np.pi / 2, np.pi / 2]), np.zeros(3))
    np.testing.assert_allclose(where[1], [0.0, 1.0, 0.0], atol=1e-12)


def test_the_root_offset_counts():
    body = Skeleton("point", (Joint("root", -1, (1.0, 2.0, 3.0), channels=("rx",)),))
    np.testing.assert_allclose(ahead(body, np.array([0.7]), np.ones(3))[0], [2.0, 3.0, 4.0])


def test_gradient_agrees_with_finite_differences(skeleton: Skeleton, make):
    motion = make()
    angle, root = motion["angle"].values[7], motion["root_position"].values[7]
    weight = np.random.default_rng(1).normal(size=(len(skeleton), 3))

    @jax.jit
    def energy(angle, root):
        return jnp.sum(weight * forward(skeleton, angle, root) ** 2)

    slope, root_slope = map(np.asarray, jax.jit(jax.grad(energy, (0, 1)))(angle, root))
    step = 1e-5
    for column in range(len(angle)):
        change = step * np.eye(len(angle))[column]
        numeric = (energy(angle + change, root) - energy(angle - change, root)) / (2 * step)
        assert slope[column] == pytest.approx(float(numeric), rel=1e-6, abs=1e-6)
    for column in range(3):
        change = step * np.eye(3)[column]
        numeric = (energy(angle, root + change) - energy(angle, root - change)) / (2 * step)
        assert root_slope[column] == pytest.approx(float(numeric), rel=1e-6)


slopes = jax.jit(jax.jacobian(forward, 1), static_argnums=0)


@pytest.mark.parametrize("value", [0.0, np.pi / 2, np.pi, -2 * np.pi, 1e6])
def test_gradient_is_finite_everywhere(skeleton: Skeleton, value: float):
    angle = np.full(len(skeleton.dofs), value)
    assert np.isfinite(slopes(skeleton, angle, np.zeros(3))).all()


def test_compiled_batched_and_mapped_are_the_same(skeleton: Skeleton, make):
    motion = make(frames=12)
    angle, root = motion["angle"].values, motion["root_position"].values
    plain = forward(skeleton, angle, root)
    compiled = ahead(skeleton, angle, root)
    mapped = jax.jit(jax.vmap(lambda a, r: forward(skeleton, a, r)))(angle, root)
    folded = forward(skeleton, angle.reshape(3, 4, -1), root.reshape(3, 4, 3))
    for other in (compiled, mapped, folded.reshape(plain.shape)):
        np.testing.assert_allclose(other, plain, atol=1e-12)


def test_the_graph_grows_with_depth_not_with_joints():
    def size(joints: int) -> int:
        root = Joint("root", -1, (0.0, 0.0, 0.0), channels=("rx",))
        fingers = tuple(
            Joint(f"finger{n}", 0, (1.0, 0.0, 0.0), channels=("rx", "ry")) for n in range(joints)
        )
        body = Skeleton("hand", (root, *fingers))
        graph = jax.make_jaxpr(lambda a: forward(body, a, jnp.zeros(3)))
        return len(graph(np.zeros(len(body.dofs))).eqns)

    assert size(30) == size(2)


def test_positions_of_several_clips_and_skeletons(make, skeleton: Skeleton):
    other = Skeleton(
        "stick",
        (
            Joint("root", -1, (0.0, 0.0, 0.0), channels=("rz",)),
            Joint("tip", 0, (0.0, 1.0, 0.0)),
        ),
    )
    stick = make_motion(
        other, np.full((3, 1), np.pi / 2), np.zeros((3, 3)), frame_rate=120.0, clip="stick"
    )
    long = make("long", frames=700)  # more than one chunk
    where = positions(concat([long, stick]))
    assert where.sizes == {"frame": 703, "joint": len(skeleton) + 1, "space": 3}
    expected = ahead(skeleton, long["angle"].values, long["root_position"].values)
    np.testing.assert_allclose(where.sel(joint=list(skeleton.names))[:700], expected, atol=1e-12)
    np.testing.assert_allclose(where.sel(joint="tip")[700:], [[-1.0, 0.0, 0.0]] * 3, atol=1e-12)
    assert where.sel(joint="tip")[:700].isnull().all()
    assert where["clip"].values[702] == "stick"


def test_positions_of_interleaved_clips_stay_with_their_frames(make):
    both = concat([make("a", frames=5), make("b", frames=5, seed=1)])
    order = np.array([0, 5, 1, 6, 2, 7, 3, 8, 4, 9])
    np.testing.assert_array_equal(positions(both.isel(frame=order)), positions(both)[order])


@pytest.mark.real_data
@pytest.mark.parametrize("trial", ["02/02_02", "35/35_18", "07/07_12"])
def test_bvh_positions_are_those_of_pybvh(data_root: Path, trial: str):
    path = data_root / "cmu" / f"{trial}.bvh"
    expected = pybvh.read_bvh_file(path, world_up="+y").node_positions()
    np.testing.assert_allclose(positions(read_bvh(path)), expected, atol=1e-10)


@pytest.mark.real_data
@pytest.mark.parametrize(
    ("trial", "in_bvh", "in_amc"),
    # The BVH release has a T-pose before the first frame, 07_12 an empty frame after it.
    # The AMC of 07_12 was made from the BVH, and solves one foot only from frame 6 on.
    [("02/02_02", 1, 0), ("35/35_18", 1, 0), ("07/07_12", 7, 5)],
)
def test_amc_and_bvh_of_one_trial_agree(data_root: Path, trial: str, in_bvh: int, in_amc: int):
    amc = read_amc(data_root / "cmu" / f"{trial}.amc")
    bvh = read_bvh(data_root / "cmu" / f"{trial}.bvh")
    a, b = positions(amc)[in_amc:].values, positions(bvh)[in_bvh:].values
    assert len(a) == len(b)
    body, other = skeleton_of(amc), skeleton_of(bvh)
    for mine, theirs in BELOW_THORAX.items():
        difference = a[:, body.index(mine)] - b[:, other.index(theirs)]
        assert np.abs(difference).max() < 5e-3, mine
    # The release leaves out the length of the thorax: everything above it is lower by
    # the thorax bone as it is turned at the time, and nothing else.
    turned = np.asarray(turned_by(body, amc["angle"].values[in_amc:]))
    bone = np.array(body.joints[body.index("lowerneck")].offset)
    thorax = turned[:, body.index("thorax")] @ bone
    assert np.linalg.norm(bone) > 1.0
    for mine, theirs in ABOVE_THORAX.items():
        difference = a[:, body.index(mine)] - thorax - b[:, other.index(theirs)]
        assert np.abs(difference).max() < 5e-3, mine
