"""Bodies of all conventions: the same person recorded under other names, in other rest poses.

Joints of the recorded body are put into another tree, called otherwise. Where that has fewer
joints, those that it lacks are still. In its rest pose the arms hang, or are held out, and it
stands along other axes; where a joint is, at any time, stays the same.
"""

import itertools
import warnings
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import bayesmotion as bm
from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.models.keyposes.data import with_beats, with_keyposes
from bayesmotion.motion import Joint, Skeleton, make_motion, positions, skeleton_of, split
from bayesmotion.motion.anatomy import anatomical_angles
from bayesmotion.motion.cycles import joint_positions, rotation_vectors
from bayesmotion.motion.euler import continuous_angles
from bayesmotion.motion.gait_skeleton import (
    gait_skeleton,
    limb_rotations,
    source_joints,
    turning_joints,
)
from bayesmotion.motion.kinematics import poses, rest_places
from bayesmotion.motion.masses import joint_masses
from bayesmotion.motion.roles import ROLES, required_joints
from bayesmotion.motion.size import body_size
from bayesmotion.motion.synthetic.dance import synthetic_dance
from bayesmotion.motion.synthetic.walkers import synthetic_walkers

# What some conventions have no joints for.
STILL = ("upperback", "thorax", "lowerneck", "upperneck", "clavicle", "hand", "fingers", "thumb")
HELD_OUT, HANGING, SLOPING = 0.0, 90.0, 40.0
Z_UP = Rotation.from_euler("x", 90, degrees=True)
SIDEWAYS = Rotation.from_euler("y", -90, degrees=True)


@dataclass(frozen=True)
class Convention:
    """Names of the joints, of the limbs with a place for the side, and the rest pose."""

    pelvis: tuple[str, ...]
    spine: tuple[str, ...]
    neck: str
    head: str
    leg: tuple[str, ...]
    arm: tuple[str, ...]
    clavicle: str = ""
    fingers: str = ""
    side: tuple[str, str] = ("Left", "Right")
    arms: float = HELD_OUT
    axes: Rotation = field(default_factory=Rotation.identity)
    order: tuple[str, str, str] = ("rz", "ry", "rx")
    unit: float = 100.0
    turned: float = 0.0

    def joints(self):
        """Name, parent, the joint that moves as it does, the joints in whose middle it is."""
        trunk = ["root"] * len(self.pelvis)
        spines = {1: "0", 2: "02", 3: "012", 4: "0123"}[len(self.spine)]
        trunk += [("lowerback", "upperback", "thorax", "thorax")[int(i)] for i in spines]
        places = [(source,) for source in trunk]
        if len(self.spine) == 4:
            places[-1] = ("thorax", "lowerneck")
        names = [*self.pelvis, *self.spine, self.neck, self.head]
        yield from zip(
            [*names, f"{self.head}_end"], [None, *names],
            [*trunk, "lowerneck", "head", "head_end"],
            [*places, ("lowerneck",), ("head",), ("head_end",)], strict=True,
        )  # fmt: skip
        for short, side in zip("lr", self.side, strict=True):
            yield from self._limb(short, side)

    def _limb(self, short, side):
        above = self.pelvis[-1]
        plain, source = iter(("femur", "tibia", "foot", "toes")), ""
        for name in self.leg:
            source = source if name in BETWEEN else f"{short}{next(plain)}"
            at = [short + joint for joint in BETWEEN.get(name, ())] or [source]
            yield name.format(side), above, source, at
            above = name.format(side)
        yield f"{above}_end", above, f"{short}toes_end", (f"{short}toes_end",)
        above = self.spine[-1]
        hand = ("humerus", "radius", "wrist")
        arm = [*zip(self.arm, hand, strict=True)]
        arm = [(self.clavicle, "clavicle"), *arm] if self.clavicle else arm
        arm = [*arm, (self.fingers, "fingers")] if self.fingers else arm
        for name, source in arm:
            yield name.format(side), above, f"{short}{source}", (f"{short}{source}",)
            above = name.format(side)
        end = f"{short}fingers_end" if self.fingers else f"{short}fingers"
        yield f"{above}_end", above, end, (end,)

    def frames(self, sources):
        """Rest frames of the joints, against those of the recorded body."""
        made = []
        for place, source in enumerate(sources):
            down = {"l": -self.arms, "r": self.arms}[source[0]] if source[1:] in ARM else 0.0
            frame = self.axes * Rotation.from_euler("z", down, degrees=True)
            axis = np.random.default_rng(place).normal(size=3)
            turned = Rotation.from_rotvec(self.turned * axis / np.linalg.norm(axis))
            made.append((turned * frame).inv())
        return made

    def record(self, motion):
        """Return one clip as recorded by this convention."""
        skeleton = skeleton_of(motion)
        where, turns = poses(skeleton, motion["angle"].values, motion["root_position"].values)
        rest = rest_places(skeleton)
        names, parents, sources, places = zip(*self.joints(), strict=True)
        at = np.array([rest[[skeleton.index(j) for j in place]].mean(axis=0) for place in places])
        C = self.frames(sources)
        joints, columns, world = [], [], []
        for index, name in enumerate(names):
            own = Rotation.from_matrix(turns[:, skeleton.index(sources[index])])
            if "Roll" in name:
                own = own * Rotation.from_rotvec(ROLL[: len(own), None] * [0.0, 1.0, 0.0])
            world.append(own * C[index])
            parent = -1 if parents[index] is None else names.index(parents[index])
            offset = np.zeros(3)
            if parent >= 0:
                offset = C[parent].inv().apply(at[index] - at[parent]) * self.unit
            turning = not name.endswith("_end")
            channels = self.order if turning else ()
            joints.append(Joint(name, parent, tuple(offset.tolist()), channels=channels))
            if turning:
                local = world[parent].inv() * world[index] if parent >= 0 else world[index]
                columns.append(continuous_angles(local, "".join(c[1].upper() for c in self.order)))
        clip, root = str(motion["clip"].values[0]), where[:, 0] * self.unit
        rate, labels = float(motion.attrs["frame_rate"]), {"subject": "ann"}
        body = Skeleton("body", tuple(joints))
        angle = np.concatenate(columns, axis=1)
        return make_motion(body, angle, root, frame_rate=rate, clip=clip, labels=labels)


ARM = ("humerus", "radius", "wrist", "fingers", "fingers_end")
# Joints that others do not have, and between which joints they are.
BETWEEN = {"{}UpLegRoll": ("femur", "tibia"), "calcn_{}": ("foot", "toes")}
ROLL = 0.4 * np.sin(np.arange(2000) / 9.0)

CONVENTIONS = {
    "cmu_bvh": Convention(
        ("Hips",), ("LowerBack", "Spine", "Spine1"), "Neck", "Head",
        ("{}UpLeg", "{}Leg", "{}Foot", "{}ToeBase"), ("{}Arm", "{}ForeArm", "{}Hand"),
        "{}Shoulder", "{}FingerBase", unit=17.7,
    ),
    "mixamo": Convention(
        ("mixamorig:Hips",), ("mixamorig:Spine", "mixamorig:Spine1", "mixamorig:Spine2"),
        "mixamorig:Neck", "mixamorig:Head",
        ("mixamorig:{}UpLeg", "mixamorig:{}Leg", "mixamorig:{}Foot", "mixamorig:{}ToeBase"),
        ("mixamorig:{}Arm", "mixamorig:{}ForeArm", "mixamorig:{}Hand"),
        "mixamorig:{}Shoulder", "mixamorig:{}HandMiddle1", order=("ry", "rx", "rz"),
    ),
    "motionbuilder": Convention(
        ("Hips",), ("Spine", "Spine1"), "Neck", "Head",
        ("{}UpLeg", "{}UpLegRoll", "{}Leg", "{}Foot", "{}ToeBase"),
        ("{}Arm", "{}ForeArm", "{}Hand"), "{}Shoulder", axes=SIDEWAYS,
    ),
    "xsens": Convention(
        ("Pelvis",), ("L5", "L3", "T12", "T8"), "Neck", "Head",
        ("{}UpperLeg", "{}LowerLeg", "{}Foot", "{}Toe"), ("{}UpperArm", "{}ForeArm", "{}Hand"),
        "{}Shoulder", arms=HANGING, order=("ry", "rx", "rz"),
    ),
    "rokoko": Convention(
        ("Hips",), ("Spine", "Chest"), "Neck", "Head",
        ("{}Thigh", "{}Shin", "{}Foot", "{}Toe"), ("{}Arm", "{}Forearm", "{}Hand"),
        "{}Shoulder", "{}Finger3Metacarpal", order=("rz", "rx", "ry"),
    ),
    "bandai_namco": Convention(
        ("Hips",), ("Spine", "Chest"), "Neck", "Head",
        ("UpperLeg_{}", "LowerLeg_{}", "Foot_{}", "Toes_{}"),
        ("UpperArm_{}", "LowerArm_{}", "Hand_{}"), "Shoulder_{}", side=("L", "R"), arms=SLOPING,
    ),
    "biped": Convention(
        ("Bip01", "Bip01 Pelvis"),
        ("Bip01 Spine", "Bip01 Spine1", "Bip01 Spine2", "Bip01 Spine3"),
        "Bip01 Neck", "Bip01 Head",
        ("Bip01 {} Thigh", "Bip01 {} Calf", "Bip01 {} Foot", "Bip01 {} Toe0"),
        ("Bip01 {} UpperArm", "Bip01 {} Forearm", "Bip01 {} Hand"),
        "Bip01 {} Clavicle", "Bip01 {} Finger2", side=("L", "R"), axes=Z_UP * SIDEWAYS,
        order=("rx", "ry", "rz"),
    ),
    "opensim": Convention(
        ("pelvis",), ("torso",), "neck", "head",
        ("femur_{}", "tibia_{}", "talus_{}", "calcn_{}", "toes_{}"),
        ("humerus_{}", "ulna_{}", "hand_{}"), side=("l", "r"), unit=1.0, arms=HANGING,
    ),
    "smpl": Convention(
        ("pelvis",), ("spine1", "spine2", "spine3"), "neck", "head",
        ("{}_hip", "{}_knee", "{}_ankle", "{}_foot"), ("{}_shoulder", "{}_elbow", "{}_wrist"),
        "{}_collar", "{}_hand", side=("left", "right"), arms=SLOPING, unit=1.0, axes=Z_UP,
    ),
    "smpl_short": Convention(
        ("Pelvis",), ("Torso",), "Neck", "Head",
        ("{}_Hip", "{}_Knee", "{}_Ankle", "{}_Toe"), ("{}_Shoulder", "{}_Elbow", "{}_Wrist"),
        side=("L", "R"), unit=1.0,
    ),
}  # fmt: skip
# The recorded joint of every role.
PARTS = {"femur": "hip", "tibia": "knee", "foot": "ankle", "toes": "toes",
         "humerus": "shoulder", "radius": "elbow", "wrist": "wrist"}  # fmt: skip


@pytest.fixture(params=list(CONVENTIONS))
def convention(request):
    return CONVENTIONS[request.param]


def without_turns(motion, joints):
    dofs = [dof for dof in motion["dof"].values if dof.split("/")[0].lstrip("lr") in
            [joint.lstrip("lr") for joint in joints]]  # fmt: skip
    return motion.assign(angle=motion["angle"].where(~motion["dof"].isin(dofs), 0.0))


@pytest.fixture(scope="module")
def walk():
    walks = synthetic_walkers(("ann",), ("walk",), seconds=4.5, frame_rate=60.0, seed=5)
    return without_turns(split(walks)["ann-walk"], STILL)


@pytest.fixture(scope="module")
def bending():
    """A walk in which all joints turn."""
    return split(synthetic_walkers(("ben",), ("walk",), seconds=1.0, seed=5))["ben-walk"]


@pytest.fixture(scope="module")
def dance():
    made = synthetic_dance(2, beats=12)
    # What bends at the pelvis is told by the lowest spine joint, and that is not the same.
    still = without_turns(made.motion, (*STILL, "lowerback"))
    return made, with_keyposes(with_beats(still, made.beats), made.keyposes.tolist())


def bones(rotations):
    """Where the bones of the gait skeleton point that its joints turn, (frame, bone, 3)."""
    body = gait_skeleton()
    made = []
    for place, name in enumerate(turning_joints(body)):
        # No joint tells where a hand points that rests out of line with its arm.
        if name != "root" and not name.endswith("wrist"):
            at = body.index(name)
            offset = np.array(next(joint.offset for joint in body if joint.parent == at))
            made.append(rotations[:, place] @ offset / np.linalg.norm(offset))
    return np.stack(made, axis=1)


def test_the_joint_of_every_role_is_found(convention, walk):
    recorded = convention.record(walk)
    found = bm.joint_roles(recorded)
    by_name = {name: source for name, _, source, _ in convention.joints()}
    for short, side in (("l", "left"), ("r", "right")):
        for source, part in PARTS.items():
            assert by_name[found[f"{side} {part}"]] == short + source
        assert by_name[found[f"{side} fingers"]] == f"{short}fingers"
    assert found["pelvis"] == convention.pelvis[-1]
    spine = convention.spine
    assert (found["lower back"], found["chest"]) == (spine[0], spine[-1])
    assert (found["neck"], found["head"]) == (convention.neck, convention.head)
    assert found["head top"] == f"{convention.head}_end"
    assert tuple(found) == ROLES


def test_the_body_is_the_same_on_the_gait_skeleton(convention, walk):
    recorded = convention.record(walk)
    np.testing.assert_allclose(limb_rotations(recorded), limb_rotations(walk), atol=1e-9)


def test_bones_point_from_joint_to_joint_where_joints_between_bend(convention, bending):
    recorded = convention.record(bending)
    where = positions(recorded)
    ways = []
    for turns, points in source_joints(skeleton_of(recorded)).values():
        if points is not None:
            way = where.sel(joint=points).values - where.sel(joint=turns).values
            ways.append(way / np.linalg.norm(way, axis=-1, keepdims=True))
    np.testing.assert_allclose(bones(limb_rotations(recorded)), np.stack(ways, 1), atol=1e-9)


@pytest.mark.parametrize("turned", [0.5, 1.2, 2.4])
def test_bones_point_where_they_did_whatever_the_rest_pose(turned, walk):
    scrambled = Convention(
        ("Hips",), ("Spine", "Chest"), "Neck", "Head",
        ("{}UpLeg", "{}Leg", "{}Foot", "{}Toe"), ("{}Arm", "{}ForeArm", "{}Hand"), turned=turned,
    )  # fmt: skip
    made, expected = (limb_rotations(one) for one in (scrambled.record(walk), walk))
    assert bones(made).shape[1] == 15
    np.testing.assert_allclose(bones(made), bones(expected), atol=1e-9)


def test_angles_size_and_masses_are_the_same(convention, walk):
    recorded = convention.record(walk)
    one, other = (
        anatomical_angles(skeleton_of(m), positions(m).sel(joint=list(skeleton_of(m).names)).values)
        for m in (recorded, walk)
    )
    assert one.keys() == other.keys()
    for name, angle in one.items():
        np.testing.assert_allclose(angle, other[name], atol=1e-5, err_msg=name)
    sizes = [body_size(skeleton_of(m)) for m in (recorded, walk)]
    assert sizes[0] == pytest.approx(convention.unit * sizes[1])
    centres = [
        np.einsum("j,njx->nx", joint_masses(skeleton_of(m)), positions(m).values)
        for m in (recorded, walk)
    ]
    np.testing.assert_allclose(centres[0] / convention.unit, centres[1], atol=1e-9)


def test_gait_cycles_have_the_same_features(convention, walk):
    model = bm.GaitPose(surface=bm.NoSurface(), scales=(1.0,))
    made, expected = (
        model.prepare(bm.cycles_of(m, 2, poses=8)).frames.y for m in (convention.record(walk), walk)
    )
    assert made.shape[0] >= 16
    np.testing.assert_allclose(made, expected, atol=1e-6)


@pytest.mark.parametrize("up", ["z", "-z", "-y", "x"])
def test_gait_cycles_are_the_same_whichever_axis_is_up(up, walk):
    turn = {"z": ("x", 90), "-z": ("x", -90), "-y": ("z", 180), "x": ("z", -90)}[up]
    world = Rotation.from_euler(*turn, degrees=True)
    recorded = CONVENTIONS["smpl"].record(walk)
    root = ["pelvis/rz", "pelvis/ry", "pelvis/rx"]
    other = recorded.copy(deep=True)
    orientation = world * Rotation.from_euler("ZYX", recorded["angle"].sel(dof=root).values)
    other["angle"].loc[{"dof": root}] = continuous_angles(orientation, "ZYX")
    other["root_position"].values = world.apply(recorded["root_position"].values)
    made, expected = (joint_positions(rotation_vectors(bm.cycles_of(m, 1)), gait_skeleton())
                      for m in (other, walk))  # fmt: skip
    np.testing.assert_allclose(made, expected, atol=1e-5)


def test_keyposes_have_the_same_features(convention, dance):
    made, motion = dance
    recorded = convention.record(motion)
    recorded = with_keyposes(with_beats(recorded, made.beats), made.keyposes.tolist())
    model = bm.Keyposes(weights="masses")
    one, other = (model.prepare(m).minima for m in (recorded, motion))
    for found, expected in zip(one, other, strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-6)
    # By equal weights more joints say more; the minima are those of the same dance.
    frames = [bm.keyposes_of(m, made.beats)[0].frame for m in (recorded, motion)]
    near = [np.abs(frames[1] - frame).min() for frame in frames[0]]
    assert np.median(near) <= 1
    assert len(frames[0]) == pytest.approx(len(frames[1]), abs=2)


@pytest.mark.parametrize("name", ["mixamo", "biped", "xsens"])
def test_files_of_it_are_read_and_fitted(name, walk, tmp_path):
    bm.write(CONVENTIONS[name].record(walk), tmp_path / "walk.bvh")
    recorded = bm.read(tmp_path / "walk.bvh")
    np.testing.assert_allclose(limb_rotations(recorded), limb_rotations(walk), atol=1e-4)
    others = synthetic_walkers(("ben", "cas", "dee"), ("walk",), seconds=2.6, seed=5)
    cycles = bm.concat([bm.cycles_of(m, 1, poses=12) for m in (recorded, others)])
    with warnings.catch_warnings():
        # Whether the search has converged is not the point.
        warnings.filterwarnings("ignore", category=MotionWarning)
        fit = bm.fit(bm.GaitPose(), cycles, method=bm.LocalLearning(sweeps=1))
        whole = bm.reconstruct(fit, recorded, missing=["larm"])
    assert np.isfinite(whole.motion["angle"]).all()


CONTEXT, HORIZON, ARM_OF_ROLE = 16, 20, ("left shoulder", "left elbow", "left wrist")


@pytest.fixture
def files(request, tmp_path, exhaustive):
    """Recordings of two people in two gaits as BVH files; the fourth stays to be predicted."""
    if request.param != "mixamo" and not exhaustive:
        pytest.skip("all conventions with --exhaustive")
    motion = synthetic_walkers(("ann", "ben"), ("walk", "run"), seconds=2.0, frame_rate=20.0)
    rows = ["clip,subject,gait"]
    for name, clip in split(motion).items():
        subject, gait = name.split("-")
        rows.append(f"{name},{subject},{gait}")
        recorded = CONVENTIONS[request.param].record(without_turns(clip, STILL))
        bm.write(recorded, tmp_path / f"{name}.bvh")
    (tmp_path / "labels.csv").write_text("\n".join(rows) + "\n")
    return tmp_path


def standing(motion) -> None:
    """Nothing is found in a motion that was written and read again."""
    assert not bm.check(motion), [str(one) for one in bm.check(motion)]


@pytest.mark.thorough
@pytest.mark.parametrize("files", list(CONVENTIONS), indirect=True)
def test_every_task_works_on_its_files(files):
    """Read, check, fit, forecast, synthesize, reconstruct and denoise give bodies."""
    known = [files / f"{name}.bvh" for name in ("ann-walk", "ann-run", "ben-walk")]
    recordings = bm.read(*known, labels=files / "labels.csv")
    clip = bm.read(files / "ben-run.bvh")
    for motion in (recordings, clip):
        standing(motion)
    with warnings.catch_warnings():
        # What is said of so short a search is not the point.
        warnings.simplefilter("ignore", MotionWarning)
        fit = bm.fit(bm.Multifactor(), recordings, method=bm.MAP(2, 1, 300), seed=0)
        future = bm.forecast(fit, clip, context=CONTEXT, horizon=HORIZON)
        scores = bm.forecast_scores(fit, clip, future)
        made = bm.synthesize(fit, {"subject": "ben", "gait": "walk"}, 1.5)
        roles = bm.joint_roles(clip)
        hidden = [roles[role] for role in ARM_OF_ROLE]
        whole = bm.reconstruct(fit, clip, missing=hidden)
        clean = bm.denoise(clip)
    assert scores.error < min(scores.baselines.values())
    for name, motion in {"future": future, "made": made, "whole": whole, "clean": clean}.items():
        bm.write(motion.motion, files / f"{name}.bvh")
        standing(bm.read(files / f"{name}.bvh"))
    assert clean.motion.sizes == clip.sizes


def nameless(motion, seed=0):
    """Return a clip whose joints have numbers for names, and these names by the ones they had."""
    old = skeleton_of(motion)
    numbers = np.random.default_rng(seed).permutation(len(old)).tolist()
    called = {name: f"bone_{number}" for name, number in zip(old.names, numbers, strict=True)}
    joints = (Joint(called[j.name], j.parent, j.offset, j.axis, j.channels) for j in old)
    made = make_motion(
        Skeleton("nameless", tuple(joints)), motion["angle"].values,
        motion["root_position"].values, frame_rate=60.0, clip="walk", labels={"subject": "ann"},
    )  # fmt: skip
    return made, called


def test_what_names_do_not_tell_can_be_said(walk, tmp_path):
    recorded = CONVENTIONS["rokoko"].record(walk)
    made, called = nameless(recorded)
    known = {role: called[joint] for role, joint in bm.joint_roles(recorded).items()}
    with pytest.raises(InputError, match=r"no joint is found for pelvis, .*joints=\{'pelvis'"):
        limb_rotations(made)
    middle = {f"{side} {part}" for side in ("left", "right") for part in ("knee", "elbow")}
    some = {role: known[role] for role in (*middle, "head")}
    # Knees, elbows and head are enough: the tree tells the others.
    said = bm.with_joints(made, some)
    assert bm.joint_roles(said) == known
    np.testing.assert_allclose(limb_rotations(said), limb_rotations(walk), atol=1e-9)
    table = tmp_path / "joints.csv"
    table.write_text("role,joint\n" + "\n".join(f"{r}, {j}" for r, j in some.items()))
    bm.write(made, tmp_path / "walk.nc")
    for joints in (some, table):
        read = bm.read(tmp_path / "walk.nc", joints=joints)
        bm.write(read, tmp_path / "said.nc")
        assert bm.joint_roles(bm.read(tmp_path / "said.nc")) == known


def test_what_is_said_counts_more_than_names(walk):
    said = bm.with_joints(walk, {"chest": "upperback"})
    assert bm.joint_roles(said) == bm.joint_roles(walk) | {"chest": "upperback"}
    again = bm.with_joints(said, {"neck": "upperneck"})
    assert bm.joint_roles(again)["chest"] == "upperback"
    assert skeleton_of(walk).roles == ()


def test_wrong_roles_and_joints_are_told(walk, tmp_path):
    with pytest.raises(InputError, match="no role 'left thigh'"):
        bm.with_joints(walk, {"left thigh": "lfemur"})
    with pytest.raises(InputError, match="no joint LeftUpLeg"):
        bm.with_joints(walk, {"left hip": "LeftUpLeg"})
    (tmp_path / "bad.csv").write_text("joint;role\nlfemur;left hip\n")
    with pytest.raises(InputError, match="no table of the columns role and joint"):
        bm.with_joints(walk, tmp_path / "bad.csv")
    body = skeleton_of(walk)
    headless = Skeleton("x", tuple(itertools.takewhile(lambda j: j.name != "head", body)))
    with pytest.raises(InputError, match="no joint is found for head"):
        required_joints(headless, ["pelvis", "head"])
