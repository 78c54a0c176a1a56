"""Local learning: a patch of everything is the model itself, and patches cover everything."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import KDTree

from bayesmotion.distributions.topology import Surface
from bayesmotion.errors import InputError
from bayesmotion.gp.matrix_normal import patterns
from bayesmotion.inference.density import ProgramDensity
from bayesmotion.inference.optimisation.optimise import maximise
from bayesmotion.models.gait_pose import (
    GaitPose,
    NoSurface,
    OnTorus,
    PathDynamics,
    PoseCircle,
    Torus,
)
from bayesmotion.models.gait_pose import local_learning as local
from bayesmotion.models.gait_pose.data import make_cycles
from bayesmotion.models.gait_pose.surfaces import latent_start

SURFACE = Surface("torus", 10, 8, (0.5, 1.0))
AROUND = Torus(sigma=0.2)
MODEL = GaitPose(AROUND, scales=(0.5, 1.0))


def make(surface=SURFACE, model=MODEL):
    """Smooth functions of the ideal surface, with noise."""
    random = np.random.default_rng(0)
    t = surface.points()
    waves = 0.5 * random.normal(size=(3, 7))
    y = np.sin(t @ waves) + 0.05 * random.normal(size=(len(t), 7))
    sizes = [surface.poses] * (surface.gaits * len(surface.radii))
    start = latent_start(model.surface, y, surface.poses, surface.gaits, surface.radii)
    return make_cycles(y, sizes, start, model.surface)


@pytest.fixture(scope="module")
def start():
    cycles = make()
    x = cycles.start + 0.05 * np.random.default_rng(1).normal(size=cycles.start.shape)
    return {"x": x, "variance": np.array(0.9), "gamma": np.array(1.3), "beta": np.array(50.0)}


def test_the_patch_of_all_points_has_the_density_of_the_model(start):
    """But for the constant of the topology; its gradient is the same too."""
    cycles, density = make(), ProgramDensity(MODEL)
    topology = cycles.topology
    everything = np.arange(len(cycles.y))

    def patch(x, hyper):
        beyond = jnp.zeros((*topology.neighbours.shape, 3))  # none is beyond
        parts = (cycles.y, topology.neighbours, topology.weights, beyond, everything)
        return local.patch_log_density(AROUND, x, hyper, parts, topology.constrained)

    def whole(x, hyper):
        real = {"x": x, **dict(zip(local.HYPER, hyper, strict=True))}
        return density(real, (cycles,))

    x, hyper = jnp.asarray(start["x"]), jnp.log(jnp.array([start[n] for n in local.HYPER]))
    found, by_patch = jax.value_and_grad(patch, argnums=(0, 1))(x, hyper)
    expected, by_whole = jax.value_and_grad(whole, argnums=(0, 1))(x, hyper)
    np.testing.assert_allclose(found + cycles.normaliser, expected, rtol=1e-9)
    for one, other in zip(by_patch, by_whole, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)


def test_neighbours_beyond_the_patch_hold_its_edge_and_stay(start):
    """Of a point at the edge the surface's gradient is that of its own strain alone."""
    cycles = make()
    topology, patch = cycles.topology, np.arange(30)
    x = jnp.asarray(start["x"])
    beyond = x[topology.neighbours[patch]]
    parts = (
        jnp.zeros((30, 0)), topology.neighbours[patch], topology.weights[:, patch], beyond, patch
    )  # fmt: skip
    hyper = jnp.zeros(3)
    found = jax.grad(local.patch_log_density, argnums=1)(
        AROUND, x[patch], hyper, parts, topology.constrained
    )

    def energy(part):
        residual = topology.residual(x.at[patch].set(part))[patch]
        return -jnp.sum(residual**2) / AROUND.sigma**2 - jnp.sum(part**2) / (
            2 * AROUND.latent_sd**2
        )

    np.testing.assert_allclose(found, jax.grad(energy)(x[patch]), rtol=1e-7, atol=1e-9)


def test_a_sweep_covers_the_surface_with_patches_of_neighbours():
    t = SURFACE.points()
    size = local.patch_size(len(t))
    assert size == 16  # a tenth
    assert local.patch_size(1800) == 120
    assert local.patch_size(90) == 16
    assert local.patch_size(12) == 12
    patches = local.sweep(KDTree(t), t, size, np.random.default_rng(0))
    assert set(patches.ravel()) == set(range(len(t)))
    assert patches.shape[1] == size
    for patch in patches[:3]:
        apart = np.linalg.norm(t - t[patch[0]], axis=1)
        assert apart[patch].max() <= np.sort(apart)[size - 1] + 1e-9


def test_learning_climbs_the_density_of_all_points(start):
    cycles, density = make(), ProgramDensity(MODEL)
    begun = {**start, "x": cycles.start, "beta": np.array(1.0)}
    seen = []
    found = local.learn_locally(
        MODEL.program, AROUND, cycles, begun, seed=0, sweeps=12, rate=0.06,
        progress=lambda done, best: seen.append(done),
    )  # fmt: skip
    values = found.values

    def at(values):
        return float(density(density.real(values, (cycles,)), (cycles,)))

    assert at(values) > at(begun) + 100.0
    assert found.log_density == pytest.approx(at(values), rel=1e-9)
    assert 50.0 < values["beta"] < 2000.0  # the noise's precision is 400
    assert seen[-1] == 12
    compiled = local.take_steps._cache_size()
    again = local.learn_locally(MODEL.program, AROUND, cycles, begun, seed=0, sweeps=12, rate=0.06)
    np.testing.assert_array_equal(values["x"], again.values["x"])
    assert local.take_steps._cache_size() == compiled


def test_where_one_patch_is_everything_learning_finds_the_mode():
    """Of so few points a patch holds all: nothing is left that patches do not see."""
    model, recordings = GaitPose.example()
    training = model.prepare(recordings.isel(frame=slice(12)))
    found = model.local_learning(training, seed=0, sweeps=4000, rate=0.05)
    density = ProgramDensity(model)
    start = density.real(found.values, training.data)
    first = {name: jnp.asarray(value)[None] for name, value in start.items()}
    optimum = maximise(density, first, training.data, max_steps=500)
    assert optimum.log_density[0] - found.log_density < 0.1
    # In a tenth of the steps it is not there yet.
    short = model.local_learning(training, seed=0, sweeps=400, rate=0.05)
    assert found.log_density - short.log_density > 1.0


def test_points_outside_the_patches_do_not_move(start):
    cycles = make()
    learning = local.begin(start)
    before = np.asarray(learning.x)
    data = (jnp.asarray(cycles.y), jax.tree.map(jnp.asarray, cycles.topology))
    patch = np.arange(16)
    after, _ = local.take_steps(AROUND, learning, data, patch[None], np.array([0.02]))
    moved = np.abs(np.asarray(after.x) - before).max(axis=1)
    assert (moved[patch] > 0).all()
    assert (moved[16:] == 0).all()
    np.testing.assert_array_equal(np.asarray(after.count), moved > 0)


def test_models_without_patches_are_refused(start):
    for model in (
        GaitPose(NoSurface()),
        GaitPose(PoseCircle(), dynamics=PathDynamics()),
        GaitPose(OnTorus()),
    ):
        with pytest.raises(InputError, match="patches"):
            model.local_learning(model.prepare(GaitPose.example()[1]), seed=0, sweeps=1)
    cycles = make()
    seen = np.ones_like(cycles.y, bool)
    seen[0, 0] = False
    holed = replace(cycles, missing=patterns(seen))
    with pytest.raises(InputError, match="missing"):
        local.learn_locally(MODEL.program, AROUND, holed, start, seed=0, sweeps=1)
