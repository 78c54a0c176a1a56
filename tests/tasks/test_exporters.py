"""Recordings of other exporters: rest poses far from zero, other units, orders and headings.

The same people are recorded by each. An exporter turns the frame of every joint by a rotation
of its own, so that the pose in which all angles are zero is no pose of a body; positions of
the joints stay as they are.
"""

import warnings
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bayesmotion.errors import MotionWarning
from bayesmotion.inference.optimisation.map import fit_map
from bayesmotion.models.multifactor import OU, Multifactor, White
from bayesmotion.motion import concat, make_motion, skeleton_of, split, write_bvh
from bayesmotion.motion.euler import continuous_angles
from bayesmotion.motion.features import heading_of
from bayesmotion.motion.io.bvh import read_bvh
from bayesmotion.motion.kinematics import poses, positions
from bayesmotion.motion.skeleton import Joint, Skeleton
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.tasks.synthesise import synthesize

RATE = 20.0


@dataclass(frozen=True)
class Exporter:
    """Order of the rotations, units in a metre, how far rest frames are turned, heading."""

    order: tuple[str, str, str]
    unit: float = 100.0
    turned: float = 0.0
    heading: float = 0.0

    def frames(self, count: int) -> Rotation:
        """Rest frames of the joints, in radians about axes at random."""
        axes = np.random.default_rng(4).normal(size=(count, 3))
        return Rotation.from_rotvec(self.turned * axes / np.linalg.norm(axes, axis=1)[:, None])

    def record(self, motion, folder):
        """Write one clip as BVH and read it back."""
        skeleton = skeleton_of(motion)
        _, turns = poses(skeleton, motion["angle"].values, motion["root_position"].values)
        C, world = self.frames(len(skeleton)), Rotation.from_euler("Y", self.heading)
        joints, columns = [], []
        for index, joint in enumerate(skeleton):
            parent = joint.parent
            offset = joint.offset if parent < 0 else C[parent].inv().apply(joint.offset)
            turns_on = any(other.parent == index for other in skeleton)
            channels = self.order if turns_on else ()
            x, y, z = (np.asarray(offset) * self.unit).tolist()
            joints.append(Joint(joint.name, parent, (x, y, z), channels=channels))
            if turns_on:
                own = Rotation.from_matrix(turns[:, index]) * C[index]
                above = world * own if parent < 0 else own
                if parent >= 0:
                    above = (Rotation.from_matrix(turns[:, parent]) * C[parent]).inv() * own
                order = "".join(channel[1].upper() for channel in self.order)
                columns.append(continuous_angles(above, order))
        body = Skeleton(skeleton.name, tuple(joints))
        name, labels = str(motion["clip"].values[0]), {}
        for factor in ("subject", "gait"):
            labels[factor] = str(motion[factor].values[0])
        root = world.apply(motion["root_position"].values) * self.unit
        made = make_motion(body, np.concatenate(columns, axis=1), root, frame_rate=RATE, clip=name)
        write_bvh(made, folder / f"{name}.bvh")
        return read_bvh(folder / f"{name}.bvh", labels=labels)


EXPORTERS = {
    "inches": Exporter(("ry", "rx", "rz"), unit=39.4),
    "rest_pose_elsewhere": Exporter(("rz", "rx", "ry"), turned=1.2),
    "frames_at_random": Exporter(("rx", "ry", "rz"), turned=2.4),
    "walking_backwards": Exporter(("rz", "ry", "rx"), unit=1.0, turned=0.7, heading=np.pi),
}


@pytest.fixture(scope="module")
def recorded():
    return synthetic_walkers(("ann", "ben"), ("walk", "run"), seconds=2.0, frame_rate=RATE, seed=2)


@pytest.fixture(params=list(EXPORTERS))
def exported(request, recorded, tmp_path):
    exporter = EXPORTERS[request.param]
    return concat([exporter.record(part, tmp_path) for part in split(recorded).values()])


@pytest.fixture
def fitted(exported):
    with warnings.catch_warnings():
        # Whether the search has converged is not the point; what else is warned of is.
        warnings.filterwarnings("ignore", "the fit stopped", MotionWarning)
        return fit_map(Multifactor(), exported, starts=2, keep=1, max_steps=300)


def bodies(motion):
    """Joints about the root, in body heights, all walking the same way, (frame, joint, 3)."""
    ahead = Rotation.from_euler("Y", -heading_of(motion))
    where = np.einsum("ij,fkj->fki", ahead.as_matrix(), positions(motion).values)
    height = np.median(np.ptp(where[..., 1], axis=1))
    return (where - where[:, :1]) / height


def away(bodies_of_one, of_other):
    """Mean distance of a joint of the first from the nearest pose of the second."""
    apart = np.linalg.norm(bodies_of_one[:, None] - of_other[None], axis=-1).mean(axis=-1)
    return float(apart.min(axis=1).mean())


def upright(motion):
    """Least height of the head over the feet, of the body's height."""
    names = list(positions(motion)["joint"].values)
    y = positions(motion).sel(space="y").values
    up = y[:, names.index("head")] - y[:, [names.index("lfoot"), names.index("rfoot")]].mean(1)
    return float(up.min() / np.ptp(y, axis=1).max())


def test_a_recorded_cell_is_made_again_and_stands_upright(fitted, exported):
    clips = split(exported)
    for name, recording in clips.items():
        subject, gait = name.split("-")
        made = synthesize(fitted, {"subject": subject, "gait": gait}, 2.0).motion
        own = away(bodies(recording), bodies(made))
        others = [away(bodies(recording), bodies(c)) for n, c in clips.items() if n != name]
        mean_pose = away(bodies(recording), bodies(recording).mean(axis=0, keepdims=True))
        assert own < 0.02
        assert own < min(*others, mean_pose)
        assert upright(made) > 0.95 * upright(recording)


def test_positions_are_the_same_whatever_the_exporter(recorded, exported):
    for name, part in split(recorded).items():
        one, other = bodies(part), bodies(split(exported)[name])
        lengths = [np.linalg.norm(b[:, 1:] - b[:, :-1], axis=-1) for b in (one, other)]
        np.testing.assert_allclose(*lengths, atol=1e-4)


@pytest.mark.parametrize(
    ("residual", "size", "frames", "said"),
    [
        (OU(per_clip=False), [0.5], [300.0], "residuals of the clips change"),
        (OU(), [0.5, 0.5, 0.5, 0.5], [5.0, 300.0, 5.0, 5.0], "residuals of ann-run change"),
        (OU(per_clip=False), [0.5], [5.0], ""),
        (OU(per_clip=False), [1e-6], [300.0], ""),
        (White(), [0.5], [300.0], ""),
    ],
)
def test_residuals_slower_than_the_clips_are_said(recorded, residual, size, frames, said):
    model = Multifactor(residual=residual)
    values = {"residual_variance": np.array(size), "residual_time": np.array(frames)}
    told = model.cautions(model.prepare(recorded), values)
    assert len(told) == bool(said)
    assert said in "".join(told)
