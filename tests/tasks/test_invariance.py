"""What does not matter: the unit of length, where somebody goes, how a file orders its angles."""

import dataclasses
import json

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

import bayesmotion as bm
from bayesmotion.models.keyposes import Keyposes
from bayesmotion.models.keyposes.data import with_beats, with_keyposes
from bayesmotion.models.motion_tensor import MotionTensor
from bayesmotion.models.multifactor import Multifactor
from bayesmotion.motion import Skeleton, concat, positions, skeleton_of, skeletons, split
from bayesmotion.motion.cycles import cycles_of
from bayesmotion.motion.euler import in_order
from bayesmotion.motion.segments import Segmenting
from bayesmotion.motion.synthetic.dance import synthetic_dance
from bayesmotion.motion.synthetic.walkers import synthetic_truth
from bayesmotion.sensing.voxels.body import body_of, pose_body
from bayesmotion.tasks.denoise import denoise
from bayesmotion.tasks.forecast import forecast
from bayesmotion.tasks.outcome import channels_of
from bayesmotion.tasks.recognize import recognize
from bayesmotion.tasks.reconstruct import reconstruct
from bayesmotion.tasks.segment_motion import synthesise_cell
from bayesmotion.tasks.synthesise import synthesize

pytestmark = pytest.mark.slow

EXACT = 1e-6  # radians, and body heights
UNIT, TURNED = 100.0, 1.9


def with_bodies(motion: xr.Dataset, bodies: dict[str, Skeleton]) -> xr.Dataset:
    """The same clips with other skeletons."""
    stored = {name: json.loads(body.to_json()) for name, body in bodies.items()}
    return motion.assign_attrs(skeletons=json.dumps(stored))


def in_another_unit(motion: xr.Dataset) -> xr.Dataset:
    """All lengths so many times as large, and nothing said of it."""
    bodies = {}
    for name, body in skeletons(motion).items():
        joints = [
            dataclasses.replace(one, offset=tuple(UNIT * x for x in one.offset)) for one in body
        ]
        bodies[name] = dataclasses.replace(body, joints=tuple(joints))
    return with_bodies(motion.assign(root_position=UNIT * motion["root_position"]), bodies)


def going_elsewhere(motion: xr.Dataset, angle: float = TURNED) -> xr.Dataset:
    """All clips turned about the vertical."""
    turn, out = Rotation.from_euler("y", angle), motion.copy(deep=True)
    out["root_position"].values[:] = turn.apply(motion["root_position"].values)
    # The roots of these bodies turn in the frame of the world, all in one order.
    root = next(iter(skeletons(motion).values())).joints[0]
    labels = [f"{root.name}/{channel}" for channel in root.channels]
    order = "".join(channel[1].upper() for channel in root.channels)
    euler = motion["angle"].sel(dof=labels).values
    out["angle"].loc[{"dof": labels}] = (turn * Rotation.from_euler(order, euler)).as_euler(order)
    return out


def turning_in_another_order(motion: xr.Dataset) -> xr.Dataset:
    """Joints of three channels turn about the same axes in another order."""
    out, bodies = motion.copy(deep=True), {}
    for name, body in skeletons(motion).items():
        joints = []
        for joint in body:
            order = joint.channels
            if len(order) == 3:
                order = (joint.channels[1], joint.channels[2], joint.channels[0])
            joints.append(dataclasses.replace(joint, channels=order))
        bodies[name] = dataclasses.replace(body, joints=tuple(joints))
    balls = {j.name: j for body in skeletons(motion).values() for j in body}
    for joint in balls.values():
        if len(joint.channels) == 3:
            own = [f"{joint.name}/{channel}" for channel in joint.channels]
            wanted = (joint.channels[1], joint.channels[2], joint.channels[0])
            labels = [f"{joint.name}/{channel}" for channel in wanted]
            made = in_order(motion["angle"].sel(dof=own).values, joint.channels, wanted)
            out["angle"].loc[{"dof": labels}] = made
    dofs = dict.fromkeys(dof for body in bodies.values() for dof in body.dofs)
    assert list(dofs) != motion["dof"].values.tolist()
    return with_bodies(out.sel(dof=list(dofs)), bodies)


def with_joints_in_another_order(motion: xr.Dataset) -> xr.Dataset:
    """Of joints that hang on one the last comes first."""
    bodies, dofs = {}, []
    for name, body in skeletons(motion).items():
        order: list[int] = []
        left = [0]
        while left:
            index = left.pop()
            order.append(index)
            left += [i for i, joint in enumerate(body) if joint.parent == index]
        joints = [
            dataclasses.replace(
                body.joints[i],
                parent=order.index(body.joints[i].parent) if i else -1,
            )
            for i in order
        ]
        bodies[name] = dataclasses.replace(body, joints=tuple(joints))
        dofs += [dof for dof in bodies[name].dofs if dof not in dofs]
    assert dofs != motion["dof"].values.tolist()
    return with_bodies(motion.sel(dof=dofs), bodies)


WAYS = {
    "unit": in_another_unit,
    "heading": going_elsewhere,
    "order of rotations": turning_in_another_order,
    "order of joints": with_joints_in_another_order,
}


@pytest.fixture(params=list(WAYS))
def way(request):
    """Give a way to record the same otherwise."""
    return WAYS[request.param]


def same(one: xr.Dataset, other: xr.Dataset) -> None:
    """Motions are the same: places of joints as seen from the first root, in its size."""
    places = []
    for motion in (one, other):
        where = positions(motion).sortby("joint")
        root = where.sel(joint="root").isel(frame=0, drop=True)
        places.append((where - root).values)
    size = np.linalg.norm(places[0][0], axis=1).max()
    unit = round(np.linalg.norm(places[1][0], axis=1).max() / size)
    assert unit in (1, UNIT)
    np.testing.assert_allclose(places[1] / unit, places[0], atol=EXACT * size)
    np.testing.assert_array_equal(one["clip"], other["clip"])


def back(motion: xr.Dataset, way) -> xr.Dataset:
    """A motion turned back where it was turned."""
    return going_elsewhere(motion, -TURNED) if way is going_elsewhere else motion


def by_label(values: np.ndarray, labels) -> np.ndarray:
    """Columns in the order of their labels."""
    return values[:, np.argsort(np.asarray(labels))]


@pytest.fixture(scope="module")
def unseen():
    known = synthetic_truth(gaits=("walk", "run"), seconds=2.0, frame_rate=20.0)
    return known.cell("ben", "run")


def test_features_of_motions_are_the_same(walkers, unseen, way):
    """In training, of a new clip, and where only one of these was recorded otherwise."""
    model = Multifactor()

    def seen(training, new):
        trained = model.prepare(training)
        both = trained, model.prepare(new, trained)
        labels = trained.encoding.layout.labels
        return [by_label(np.asarray(one.frames.y), labels) for one in both]

    expected = seen(walkers, unseen)
    for training in (walkers, way(walkers)):
        for new in (unseen, way(unseen)):
            for one, other in zip(seen(training, new), expected, strict=True):
                np.testing.assert_allclose(one, other, atol=1e-8)


def test_clips_of_bodies_recorded_otherwise_train_together(walkers, way):
    """Some of the people by one file format, some by another one."""
    parts, others = split(walkers), split(way(walkers))
    mixed = concat([(others if one.startswith("ben") else parts)[one] for one in parts])
    model = Multifactor()
    one, other = model.prepare(walkers), model.prepare(mixed)
    np.testing.assert_allclose(other.frames.y, one.frames.y, atol=1e-8)


@pytest.fixture(scope="module")
def expected(circle_fit, unseen):
    return (
        forecast(circle_fit, unseen, context=16, horizon=20),
        reconstruct(circle_fit, unseen, ["lradius"], draws=1),
        synthesize(circle_fit, {"subject": "ben", "gait": "walk"}, 0.5),
    )


def test_motions_are_forecast_filled_in_and_made_alike(circle_fit, walkers, unseen, expected, way):
    clip = way(unseen)
    future = forecast(circle_fit, clip, context=16, horizon=20)
    np.testing.assert_allclose(future.mean, expected[0].mean, atol=EXACT)
    same(expected[0].motion, back(future.motion, way))
    whole = reconstruct(circle_fit, clip, ["lradius"], draws=1)
    np.testing.assert_allclose(whole.mean, expected[1].mean, atol=EXACT)
    same(expected[1].motion, back(whole.motion, way))
    if way is not with_joints_in_another_order:  # of which sites of a fit have the order
        fit = dataclasses.replace(circle_fit, motion=way(walkers))
        made = synthesize(fit, {"subject": "ben", "gait": "walk"}, 0.5)
        same(expected[2].motion, made.motion)


def test_tables_tell_lengths_in_the_unit_of_the_clip(expected):
    future = expected[0]
    for motion, unit in ((future.motion, 1.0), (in_another_unit(future.motion), UNIT)):
        channels = channels_of(future.prediction, skeleton_of(motion))
        travel = np.char.startswith(channels.labels, "travel/")
        assert travel.sum() == 3
        np.testing.assert_array_equal(np.broadcast_to(channels.scale, travel.shape)[~travel], 1.0)
        told = (future.mean * channels.scale)[16:, travel]
        gone = np.diff(motion["root_position"].values, axis=0)[15:]
        np.testing.assert_allclose(
            np.linalg.norm(told, axis=1), np.linalg.norm(gone, axis=1), atol=1e-9 * unit
        )


def test_gait_cycles_are_the_same(gait_clips, trained_gait, way):
    fit, _ = trained_gait
    names = ["ann-walk", "new-walk"]
    parts = split(gait_clips)
    some = concat([parts[name] for name in names])
    one, other = (cycles_of(clips, 1, poses=12) for clips in (some, way(some)))
    np.testing.assert_allclose(other["angle"], one["angle"], atol=EXACT)
    np.testing.assert_allclose(other["root_position"], one["root_position"], atol=EXACT)
    for task in (reconstruct, denoise) if way is in_another_unit else ():
        found = [task(fit, each, ["larm"]) for each in (parts["new-walk"], way(parts["new-walk"]))]
        np.testing.assert_allclose(found[1].mean, found[0].mean, atol=EXACT)
        same(found[0].motion, found[1].motion)


@pytest.fixture(scope="module")
def noisy(unseen):
    noise = np.deg2rad(2.0) * np.random.default_rng(0).normal(size=unseen["angle"].shape)
    return unseen.assign(angle=unseen["angle"] + noise)


@pytest.fixture(scope="module")
def without_noise(noisy):
    return denoise(noisy)


def test_recordings_are_denoised_alike(noisy, without_noise, way):
    other = denoise(way(noisy))
    assert other.noise_degrees == pytest.approx(without_noise.noise_degrees, rel=1e-9)
    same(without_noise.motion, back(other.motion, way))


@pytest.fixture(scope="module")
def tensor_fit(acted):
    segments = acted(("ann", "ben", "cat"), ("bow", "wave"), 3)
    known = ~segments["clip"].str.endswith("2").values
    model = MotionTensor(segmenting=Segmenting("both", 2))
    fit = bm.fit(model, segments.isel(frame=known), method=bm.MAP(initial=1, keep=1))
    return fit, segments.isel(frame=~known)


def test_segments_are_recognised_and_made_alike(tensor_fit, way):
    fit, probes = tensor_fit
    expected, made = recognize(fit, probes), synthesise_cell(fit, {"subject": "ann", "task": "bow"})
    xr.testing.assert_allclose(recognize(fit, way(probes)), expected, rtol=1e-6, atol=1e-9)
    if way is with_joints_in_another_order:
        # Columns come in another order, of which the singular vectors do not know.
        one, other = fit.training.tensor.y, fit.model.prepare(way(fit.motion)).tensor.y
        np.testing.assert_allclose(other @ other.T, one @ one.T, atol=1e-8)
        return
    trained = dataclasses.replace(fit, motion=way(fit.motion))
    np.testing.assert_allclose(trained.training.tensor.y, fit.training.tensor.y, atol=1e-8)
    for new in (probes, way(probes)):
        xr.testing.assert_allclose(recognize(trained, new), expected, rtol=1e-6, atol=1e-9)
    same(made, synthesise_cell(trained, {"subject": "ann", "task": "bow"}))


def test_keyposes_are_found_alike(way):
    dance = synthetic_dance(0, beats=12)
    clip = with_keyposes(with_beats(dance.motion, dance.beats), dance.keyposes.tolist())
    model, data = Keyposes(), {}
    for name, one in (("as it is", clip), ("otherwise", way(clip))):
        data[name] = model.prepare(one)
    one, other = (each.minima for each in data.values())
    for here, there in zip(one, other, strict=True):
        np.testing.assert_allclose(there, here, atol=1e-6)


def test_bodies_of_voxels_are_as_tall_in_any_unit(unseen):
    """Where a file does not say its unit."""
    ((name, body),) = skeletons(unseen).items()
    clip = with_bodies(unseen, {name: dataclasses.replace(body, metres=None)})
    found = []
    for one in (clip, in_another_unit(clip)):
        (own,) = skeletons(one).values()
        found.append(pose_body(body_of(own), one))
    for here, there in zip(*found, strict=True):
        np.testing.assert_allclose(there, here, rtol=1e-6, atol=1e-9)
