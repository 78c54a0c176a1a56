"""Poses from voxels: the program by hand, the estimate of the paper, predictions, calibration."""

from dataclasses import fields, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import pytest
from numpyro.infer.util import log_density as program_density
from scipy.stats import lognorm, multivariate_normal

from bayesmotion.errors import InputError
from bayesmotion.fit import load
from bayesmotion.inference.density import sites_of
from bayesmotion.inference.methods import EM, fit
from bayesmotion.model import draw_sites
from bayesmotion.models.clusters import find_clusters
from bayesmotion.models.voxel_pose import VoxelPose, voxel_recordings
from bayesmotion.models.voxel_pose.data import joined
from bayesmotion.models.voxel_pose.features import Descriptors, describe, features, mean_shares
from bayesmotion.models.voxel_pose.joint_angles import rms_degrees
from bayesmotion.models.voxel_pose.mixture_ppca.density import Mixture
from bayesmotion.models.voxel_pose.mixture_ppca.em import log_density, responsibilities
from bayesmotion.models.voxel_pose.regression import basis, median_distance, search
from bayesmotion.models.voxel_pose.relevance_vectors.data import basis_functions
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.sensing.voxels.cameras import circle
from bayesmotion.sensing.voxels.carving import Hull, hulls
from bayesmotion.sensing.voxels.shape_context import ShapeContext
from bayesmotion.studies.voxel.models import Recognizer, Regressor, coverage, features_of
from bayesmotion.tasks.recognize_pose import recognize_pose

drawn_sites = jax.jit(draw_sites, static_argnums=0)
condition = jax.jit(VoxelPose.condition, static_argnums=0)
predicted = jax.jit(VoxelPose.predict, static_argnums=0)
identified = jax.jit(VoxelPose.identified, static_argnums=0)
in_jax = jax.jit(features, static_argnums=3)


@partial(jax.jit, static_argnums=0)
def drawn_precisions(model, key, frames):
    """Alone they compile in a part of the time."""
    drawn = draw_sites(model, key, frames)
    return {name: drawn[name] for name in ("alpha", "noise")}


@partial(jax.jit, static_argnums=0)
def density_of(program, frames, sites):
    return program_density(program, (frames,), {}, sites)[0]


@pytest.fixture(scope="module")
def walk():
    return VoxelPose.example()


def take(noise: float):
    """Voxels of a walk of two seconds as five cameras see it; takes differ by their noise."""
    walk = synthetic_walkers(["ann"], ["walk"], seconds=2.0, seed=1, noise=noise)
    recordings = voxel_recordings(walk, circle(5))
    angle = recordings["angle"].copy()
    angle[[3, 10]] = np.nan
    return recordings.assign(angle=angle)


@pytest.fixture(scope="module")
def other_walk():
    return take(0.011)


@pytest.fixture(scope="module")
def fitted():
    model = VoxelPose(ShapeContext(3, 4, 6), cell=5, components=12, latent=3, mixture_points=3000)
    return fit(model, take(0.01), method=EM(max_steps=6), seed=0)


def test_poses_are_recognised(other_walk, fitted):
    true = other_walk["angle"].values
    seen = ~np.isnan(true).any(axis=1)
    found = recognize_pose(fitted, other_walk)
    still = np.broadcast_to(true[seen].mean(axis=0), true[seen].shape)
    error = rms_degrees(true[seen], found.angles[seen])
    assert error < 0.6 * rms_degrees(true[seen], still)
    assert coverage(true[seen], found.angles[seen], found.sd[seen]) > 0.7
    # A knee turns about one axis: two of its angles stay, and nothing is unsure of them.
    moves = true[seen].std(axis=0) > 1e-4
    assert 20 < moves.sum() < 42
    assert (found.sd[:, moves] > 0).all()
    # Poses that come with the voxels are not looked at.
    blind = recognize_pose(fitted, other_walk.drop_vars("angle"))
    np.testing.assert_array_equal(blind.angles, found.angles)
    motion = found.motion(np.zeros((len(true), 3)), frame_rate=8.0, clip="found")
    assert motion.sizes["frame"] == len(true)


def test_a_fit_comes_back_from_its_file(other_walk, fitted, tmp_path):
    fitted.save(tmp_path / "fit.nc")
    again = load(tmp_path / "fit.nc")
    assert again.model == fitted.model
    assert again.model.context == ShapeContext(3, 4, 6)
    one, other = recognize_pose(fitted, other_walk), recognize_pose(again, other_walk)
    np.testing.assert_array_equal(one.angles, other.angles)
    np.testing.assert_array_equal(one.sd, other.sd)
    assert (one.skeleton, one.rest) == (other.skeleton, other.rest)
    posterior = again.tree["posterior"]
    assert {"mixture_mean", "alpha", "weight", "length", "held_out"} <= set(posterior.data_vars)


def test_the_estimate_is_the_search_and_predicts_as_it_does(other_walk, fitted):
    """The mixture by EM, its features, and the regression on them: as the study does it."""
    model, training = fitted.model, fitted.training
    values = fitted.values()
    mixture = Mixture(*(values[f"mixture_{name}"] for name in Mixture._fields))
    frames = training.frames
    counts = np.bincount(frames.frame)
    x = features_of(Descriptors(frames.descriptors, counts), mixture)
    known = ~np.isnan(frames.pose).any(axis=1)
    found = search(
        x, frames.pose, training.space.scale, length=None, least_noise=model.least_noise,
        most=model.candidates,
    )  # fmt: skip
    assert float(values["length"]) == found.length
    kept = found.relevant.kept
    np.testing.assert_allclose(values["alpha"][kept], found.relevant.alpha, rtol=1e-3)
    assert (np.delete(values["alpha"], kept) >= 1e10).all()
    vectors = np.full((len(kept), x.shape[1]), np.nan)
    vectors[kept > 0] = x[found.centres[kept[kept > 0] - 1]]
    regressor = Regressor(
        training.space, vectors, found.length_scale, found.relevant, found.held_out, len(x)
    )
    again = recognize_pose(fitted, other_walk)
    recogniser = Recognizer(model, mixture, regressor, again.skeleton, again.rest, 0.0)
    described = describe(hulls(_whole(other_walk)), model.context, model.cell)
    angles, sd = recogniser(described)
    np.testing.assert_allclose(again.angles, angles, atol=2e-4)
    np.testing.assert_allclose(again.sd, sd, rtol=2e-3, atol=1e-9)
    assert known.sum() == 58
    kept_in_a_file = Regressor.from_arrays(regressor.arrays())
    for one, other in zip(kept_in_a_file(x), regressor(x), strict=True):
        np.testing.assert_array_equal(one, other)


def _whole(recordings):
    return recordings.assign(voxel=recordings["voxel"].astype(np.int64))


@pytest.fixture(scope="module")
def small():
    """Frames of the calibration case with drawn outcomes, and the draw."""
    case, data = VoxelPose().sbc_case()
    draw = jax.jit(case.draw, static_argnums=0)
    values, seen = jax.tree.map(np.asarray, draw(case.model, jax.random.key(3), data))
    pose = np.array(seen.pose)
    pose[2, 0] = pose[5] = np.nan
    return case.model, seen._replace(pose=pose), values


def test_the_program_has_the_density_of_its_equations(small):
    model, frames, values = small
    mixture = Mixture(*(values[f"mixture_{name}"] for name in Mixture._fields))
    share = responsibilities(mixture, frames.descriptors).reshape(8, 3, 2)
    x = np.sqrt(share.mean(axis=1))
    apart = np.linalg.norm(x[:, None] - x, axis=2)[np.triu_indices(8, 1)]
    length = values["length"] * np.median(apart)
    phi = basis_functions(x, x[frames.centres], length)

    def normal(x, loc, scale):
        return float(np.sum(-0.5 * ((x - loc) / scale) ** 2 - np.log(scale * np.sqrt(2 * np.pi))))

    expected = normal(mixture.mean, 0.0, 2.0) + normal(mixture.factor, 0.0, 1.0)
    expected += lognorm(1.5, scale=0.1).logpdf(mixture.noise).sum()
    expected += log_density(mixture, np.asarray(frames.points.t)).sum()
    expected += lognorm(0.5, scale=0.7).logpdf(values["length"])
    expected += lognorm(4.0).logpdf(values["alpha"]).sum()
    noise = lognorm(2.0, scale=0.01)
    expected += (noise.logpdf(values["noise"]) - np.log(noise.sf(0.2))).sum()
    collapsed = expected
    for p in range(2):
        o = ~np.isnan(frames.pose[:, p])
        C = (phi / values["alpha"]) @ phi.T + values["noise"][p] * np.eye(8)
        collapsed += multivariate_normal(np.zeros(o.sum()), C[np.ix_(o, o)]).logpdf(
            frames.pose[o, p]
        )
        mean = phi[o] @ values["weight"][:, p]
        expected += normal(frames.pose[o, p], mean, np.sqrt(values["noise"][p]))
        expected += normal(values["weight"][:, p], 0.0, values["alpha"] ** -0.5)
    sites = {name: jnp.asarray(value) for name, value in values.items()}
    assert float(density_of(model.program, frames, sites)) == pytest.approx(expected)
    # A draw of the weights is no part of the program without them.
    del sites["weight"]
    assert float(density_of(model.collapsed, frames, sites)) == pytest.approx(collapsed)


def test_new_poses_are_conditional_normals(small):
    """Poses of frames some of which are known, against the joint Gaussian of all frames."""
    model, frames, values = small
    values = {**values, "held_out": np.zeros(2)}
    trained = condition(model, frames, values)
    new = frames._replace(pose=np.array(frames.pose)[:4], points=None, centres=None)
    order = np.r_[9:12, 3:9, 0:3]
    new = new._replace(descriptors=np.asarray(frames.descriptors)[order], frame=new.frame[:12])
    found = predicted(model, trained, new, {})["pose"]
    x = np.asarray(in_jax(trained.mixture, frames.descriptors, frames.frame, 8))
    x = np.concatenate([x, in_jax(trained.mixture, new.descriptors, new.frame, 4)])
    phi = np.asarray(jax.jit(basis)(x, trained.centres, trained.length_scale))
    every = np.concatenate([frames.pose, new.pose])
    for p in range(2):
        o = np.flatnonzero(~np.isnan(every[:, p]))
        signal = (phi / values["alpha"]) @ phi.T
        K = signal + values["noise"][p] * np.eye(12)
        gain = np.linalg.solve(K[np.ix_(o, o)], signal[o, 8:]).T
        np.testing.assert_allclose(found.mean[:, p], gain @ every[o, p], rtol=1e-5, atol=1e-7)
        left = np.diag(signal[8:, 8:] - gain @ signal[o, 8:]) + values["noise"][p]
        np.testing.assert_allclose(found.variance[:, p], left, rtol=1e-5)
    # With errors where held out they are not surer than these.
    least = condition(model, frames, {**values, "held_out": np.array([50.0, 0.0])})
    floor = predicted(model, least, new, {})["pose"]
    assert (np.asarray(floor.variance)[:, 0] >= 50.0 - 1e-9).all()
    np.testing.assert_allclose(floor.variance[:, 1], found.variance[:, 1])
    sites = sites_of(numpyro.handlers.seed(model.program, 0), (new, trained))
    assert [n for n, site in sites.items() if site["type"] == "sample"] == ["pose"]


def test_frames_left_out_are_those_of_the_joint_gaussian(small):
    model, frames, values = small
    sites = {name: jnp.asarray(v) for name, v in values.items() if name != "weight"}

    def density(pose):
        seen = frames._replace(pose=pose)
        return float(density_of(model.collapsed, seen, sites))

    found, whole = jax.jit(model.pointwise)(frames, values), density(frames.pose)
    for n in range(8):
        rest = np.array(frames.pose)
        rest[n] = np.nan
        assert float(found[n]) == pytest.approx(whole - density(rest), abs=1e-7)
    assert float(found[5]) == 0.0


def test_what_is_identified_knows_no_order_of_components(small):
    model, frames, values = small
    other = dict(values)
    for name in Mixture._fields:
        other[f"mixture_{name}"] = values[f"mixture_{name}"][::-1]
    other["mixture_factor"] = -other["mixture_factor"]
    one, same = identified(model, frames, values), identified(model, frames, other)
    for name, value in one.items():
        np.testing.assert_allclose(same[name], value, rtol=1e-6, atol=1e-9, err_msg=name)
        assert len(model.dims()[name]) == np.ndim(value)
    changed = identified(model, frames, {**values, "weight": values["weight"] + 1.0})
    assert not np.allclose(changed["signal"], one["signal"])


def test_the_estimate_is_an_optimum_of_either_part_of_the_program(walk):
    """The mixture of the descriptors' density, the regression of the poses'; feedback is cut."""
    model, recordings = walk
    data = model.prepare(recordings)
    found = model.em(data, seed=0, max_steps=1000, tolerance=1e-12)
    assert found.converged
    values = {name: jnp.asarray(value) for name, value in found.values.items()}
    names = ("mixture_mean", "mixture_factor", "alpha", "noise")

    def part(logs, which):
        positive = {n: jnp.exp(v) if n in ("alpha", "noise") else v for n, v in logs.items()}
        program = numpyro.handlers.substitute(model.collapsed, data={**values, **positive})
        site = numpyro.handlers.trace(program).get_trace(data.frames)[which]
        return jnp.sum(site["fn"].log_prob(site["value"]))

    logs = {n: jnp.log(values[n]) if n in ("alpha", "noise") else values[n] for n in names}
    parts = [jax.jit(jax.value_and_grad(part), static_argnums=1)(logs, which)
             for which in ("descriptor", "pose")]  # fmt: skip
    assert found.log_density == pytest.approx(sum(float(value) for value, _ in parts), rel=1e-4)
    (_, mixture), (_, regression) = parts
    descriptors, scale = len(data.frames.points.t), float(data.frames.points.scale)
    for name in names[:2]:
        assert float(jnp.abs(mixture[name]).max()) * scale < 1e-3 * descriptors
        # Poses would have a say: that is what is cut.
        assert float(jnp.abs(regression[name]).max()) * scale > 1e-3
    # Steps of the search that gain less than one are not taken.
    assert float(jnp.abs(regression["alpha"]).max()) < 1.0
    free = np.asarray(values["noise"]) > model.least_noise * 1.01
    assert float(jnp.abs(jnp.where(free, regression["noise"], 0.0)).max()) < 1.0


def test_the_length_is_that_which_does_best_where_held_out():
    """A wiggle that only a short kernel follows, a slope that a long one follows better."""
    random = np.random.default_rng(0)
    x = random.uniform(-1, 1, (240, 2))
    slow = np.column_stack([0.5 * x[:, 0], 0.3 * x[:, 1]])
    fast = np.column_stack([0.5 * np.sin(9 * x[:, 0]), 0.3 * np.cos(9 * x[:, 1])])
    model = VoxelPose(share=0.99)
    lengths = []
    for angles in (slow, fast):
        noisy = angles + 0.02 * random.standard_normal(angles.shape)
        found = Regressor.of(x, noisy, ["a", "b"], model)
        lengths.append(found.length_scale)
        new = random.uniform(-0.9, 0.9, (200, 2))
        z, variance = found.outputs(new)
        # Predictions are never surer than they were right on frames held out.
        assert (variance >= found.held_out).all()
        assert z.shape == (200, len(found.held_out))
    assert lengths[1] < lengths[0]
    fixed = Regressor.of(x, slow, ["a", "b"], replace(model, length=2.0))
    assert fixed.length_scale == pytest.approx(2.0 * float(median_distance(x)))
    # With fewer candidates every third frame, and the constant, may be kept.
    few = Regressor.of(x, slow, ["a", "b"], replace(model, length=2.0, candidates=80))
    rows = {tuple(row) for row in x[::3]}
    constant = np.isnan(few.vectors[:, 0])
    assert {tuple(row) for row in few.vectors[~constant]} <= rows
    assert rms_degrees(slow, few(x)[0]) < 0.3 * np.degrees(slow.std(axis=0).mean())


def test_features_are_means_of_responsibilities(fitted):
    frames, values = fitted.training.frames, fitted.values()
    mixture = Mixture(*(values[f"mixture_{name}"] for name in Mixture._fields))
    described = Descriptors(frames.descriptors, np.bincount(frames.frame))
    np.testing.assert_array_equal(described.frame, frames.frame)
    x = features_of(described, mixture)
    np.testing.assert_allclose((x**2).sum(axis=1), 1.0, rtol=1e-5)
    first = responsibilities(mixture, described.values[: described.counts[0]])
    np.testing.assert_allclose(x[0] ** 2, first.mean(axis=0), rtol=1e-5, atol=1e-12)
    again = in_jax(mixture, described.values, described.frame, len(described.counts))
    np.testing.assert_allclose(again, x, atol=1e-3)
    clusters = find_clusters(described.values, 7, seed=0)
    votes = mean_shares(described, clusters.votes)
    assert votes.shape == (len(described.counts), 7)
    last = clusters.votes(described.values[-described.counts[-1] :])
    np.testing.assert_allclose(votes[-1], last.mean(axis=0), rtol=1e-5)
    drawn = described.sample(50, seed=0)
    assert drawn.shape == (50, 72)
    assert described.sample(10**6, seed=0) is described.values


def test_clips_are_joined(walk):
    both = joined([walk[1], walk[1].assign_coords(clip=walk[1]["clip"] + "-2")])
    assert both.sizes["frame"] == 32
    assert both["frame"].values.tolist() == list(range(32))
    data = walk[0].prepare(both)
    assert set(data.clips) == {"ann-walk", "ann-walk-2"}
    assert data.frames.pose.shape[0] == 32
    assert np.isnan(data.frames.pose).any(axis=1).sum() == 4


def test_every_setting_counts(walk):
    """Of prior draws from the same key: another shape, or other numbers."""
    model, recordings = walk
    changes = {
        "context": ShapeContext(3, 2, 3), "cell": 6, "components": 4, "latent": 2, "share": 0.5,
        "mixture_points": 100, "least_noise": 0.3, "candidates": 5, "length": 0.3,
    }  # fmt: skip

    key, usual = jax.random.key(0), model.prepare(recordings).frames

    def shapes(model, frames):
        sites = jax.eval_shape(partial(draw_sites, model), key, frames)
        return {name: site.shape for name, site in sites.items()}

    drawn = drawn_sites(model, key, usual)
    assert all(np.isfinite(np.asarray(value)).all() for value in drawn.values())
    for name, value in changes.items():
        other = replace(model, **{name: value})
        frames = other.prepare(recordings).frames
        if shapes(model, usual) == shapes(other, frames):
            numbers = drawn_precisions(other, key, frames)
            assert not all(np.allclose(numbers[n], drawn[n]) for n in numbers), name
    assert set(changes) == {field.name for field in fields(VoxelPose)}


def test_what_makes_no_sense_is_refused(walk, fitted):
    model, recordings = walk
    with pytest.raises(InputError, match="no poses"):
        model.prepare(recordings.drop_vars("angle"))
    with pytest.raises(InputError, match="no voxels"):
        model.prepare(recordings.drop_vars("voxel"))
    with pytest.raises(InputError, match="lacks an angle"):
        model.prepare(recordings.assign(angle=np.nan * recordings["angle"]))
    renamed = recordings.assign_coords(dof=recordings["dof"] + "'")
    with pytest.raises(InputError, match="not those that trained"):
        model.prepare(renamed, fitted.training)
    with pytest.raises(InputError, match="there are no frames"):
        describe([], ShapeContext())
    nothing = Hull(np.zeros((0, 3), dtype=int), np.zeros(0, dtype=bool))
    with pytest.raises(InputError, match="frame 0: it has no voxels"):
        describe([nothing], ShapeContext())
    with pytest.raises(InputError, match="at least 1"):
        VoxelPose(components=0)
    with pytest.raises(InputError, match="0 candidates"):
        VoxelPose(candidates=0)
    with pytest.raises(InputError, match="length_scale"):
        VoxelPose(length=-1.0)
