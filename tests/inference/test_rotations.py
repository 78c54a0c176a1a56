"""Rotations taken out: the plane, what points on it count for, and draws of the same posterior."""

from dataclasses import dataclass
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
import xarray as xr
from scipy.stats import ortho_group, special_ortho_group

from bayesmotion.inference.sampling.nuts import fit_nuts
from bayesmotion.inference.sampling.rotations import (
    log_orbit_volume,
    orthogonal_complement,
    rotated_to,
    rotation_directions,
)
from bayesmotion.inference.sampling.typical_set import rotated, to_typical_set
from bayesmotion.inference.sampling.whitening import hessian_at, sampling_problem

POINTS, SIZE = 4, 2

orbit_volume = jax.jit(log_orbit_volume)
orbit_volumes = jax.jit(jax.vmap(log_orbit_volume, (0, None)))


def on_the_plane(random, reference, count) -> np.ndarray:
    """Standard normal points of the plane through the reference."""
    free = orthogonal_complement(rotation_directions({"x": jnp.asarray(reference)}, ("x",)))
    z = random.normal(size=(count, free.shape[1]))
    return (z @ free.T).reshape(count, *reference.shape)


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_orbits_count_by_the_sums_of_pairs_of_eigenvalues(size):
    random = np.random.default_rng(size)
    reference = random.normal(size=(7, size))
    (x,) = on_the_plane(random, reference, 1)
    S = x.T @ reference
    np.testing.assert_allclose(S, S.T, atol=1e-12)
    s = np.linalg.eigvalsh(S)
    sums = [np.log(abs(s[i] + s[j])) for i in range(size) for j in range(i)]
    # The basis of antisymmetric matrices is the same on both sides of the map.
    np.testing.assert_allclose(orbit_volume(x, reference), sum(sums), rtol=1e-10)


@pytest.mark.parametrize("size", [2, 3])
def test_points_of_the_plane_have_the_law_of_all_orbits(size):
    """Normal points on the plane, weighed, have the inner products of normal points."""
    random = np.random.default_rng(0)
    reference = random.normal(size=(POINTS, size))
    x = on_the_plane(random, reference, 20000)
    weight = np.exp(np.asarray(orbit_volumes(x, reference)))
    gram = np.einsum("sni,smi->snm", x, x)
    whole = random.normal(size=(20000, POINTS, size))
    other = np.einsum("sni,smi->snm", whole, whole)
    for power in (1, 2):
        mine, theirs = np.abs(gram) ** power, np.abs(other) ** power
        mean = np.einsum("s,snm->nm", weight, mine) / weight.sum()
        error = np.sqrt(np.einsum("s,snm->nm", weight**2, (mine - mean) ** 2)) / weight.sum()
        error = np.hypot(error, theirs.std(axis=0) / np.sqrt(len(theirs)))
        assert np.all(np.abs(mean - theirs.mean(axis=0)) < 4.5 * error)
    plain = np.einsum("snn->s", gram).mean()
    assert abs(plain - POINTS * size) > 0.3, "without the weights it must not hold"


def test_points_are_turned_as_near_as_they_come():
    random = np.random.default_rng(1)
    x, reference = random.normal(size=(2, 6, 3))
    near = rotated_to(x, reference)
    np.testing.assert_allclose(near @ near.T, x @ x.T)
    np.testing.assert_allclose(near.T @ reference, reference.T @ near)
    for R in ortho_group.rvs(3, size=50, random_state=random):
        assert np.sum((x @ R - reference) ** 2) > np.sum((near - reference) ** 2)


def test_what_turns_is_found_among_all_sites():
    random = np.random.default_rng(2)
    x = random.normal(size=(5, 3))
    rotations = rotation_directions({"a": jnp.zeros(2), "x": jnp.asarray(x)}, ("x",))
    assert rotations.shape == (17, 3)
    np.testing.assert_allclose(rotations[:2], 0.0, atol=1e-14)
    small = special_ortho_group.rvs(3, random_state=random)
    step = 1e-6 * (small - small.T)
    moved = (x @ (np.eye(3) + step) - x).ravel()
    np.testing.assert_allclose(rotations[2:] @ (rotations[2:].T @ moved), moved, atol=1e-12)
    assert orthogonal_complement(rotation_directions({"a": jnp.zeros(2)}, ())).shape == (2, 2)


@dataclass(frozen=True)
class GramData:
    y: np.ndarray

    @property
    def data(self) -> tuple:
        return (self.y,)

    def observed(self) -> xr.Dataset:
        return xr.Dataset({"y": (("point", "other"), self.y)})

    def constants(self) -> xr.Dataset:
        return xr.Dataset()


@dataclass(frozen=True)
class RotationInvariant:
    """Points in a plane of which only noisy inner products are seen."""

    name: ClassVar[str] = "turning"

    def prepare(self, motion):
        return GramData(motion["y"].values)

    def program(self, y):
        x = numpyro.sample("x", dist.Normal().expand([POINTS, SIZE]).to_event(2))
        numpyro.sample("y", dist.Normal(x @ x.T, 0.1).to_event(2), obs=y)

    def initial_values(self, training, seed, count):
        random = np.random.default_rng(seed)
        return [{"x": random.normal(size=(POINTS, SIZE))} for _ in range(count)]

    def dims(self):
        return {"x": ("point", "axis"), "y": ("point", "other")}

    def coords(self, training):
        return {"point": list(range(POINTS)), "other": list(range(POINTS)), "axis": [0, 1]}


@dataclass(frozen=True)
class Turned(RotationInvariant):
    """The same, and says what turns."""

    name: ClassVar[str] = "turned"

    @property
    def rotations(self) -> tuple[str, ...]:
        return ("x",)


@pytest.fixture(scope="module")
def grams():
    random = np.random.default_rng(5)
    x = random.normal(size=(POINTS, SIZE))
    y = x @ x.T + 0.1 * random.normal(size=(POINTS, POINTS))
    return xr.Dataset({"y": (("point", "other"), y)})


def products(fit) -> xr.DataArray:
    x = fit.tree["posterior"]["x"]
    return (x * x.rename(point="other")).sum("axis")


def test_draws_are_of_the_same_posterior_in_fewer_steps(grams):
    settings = {"warmup": 200, "draws": 500, "chains": 2, "seed": 0}
    free = fit_nuts(RotationInvariant(), grams, **settings)
    fixed = fit_nuts(Turned(), grams, **settings, start="typical")
    one, other = products(free), products(fixed)
    error = np.sqrt((one.var(("chain", "draw")) + other.var(("chain", "draw"))) / 200.0)
    difference = one.mean(("chain", "draw")) - other.mean(("chain", "draw"))
    assert float(abs(difference / error).max()) < 4.0
    ratio = other.std(("chain", "draw")) / one.std(("chain", "draw"))
    assert 0.75 < float(ratio.min()) < float(ratio.max()) < 1.35
    steps = [fit.tree["sample_stats"]["n_steps"].mean() for fit in (fixed, free)]
    assert steps[0] < 0.6 * steps[1]


def test_chains_settle_on_the_plane_and_in_its_units(grams):
    model = Turned()
    problem = sampling_problem(model, model.prepare(grams), 0, "typical")
    assert problem.unknowns == POINTS * SIZE - 1
    settled, z = to_typical_set(problem, chains=2, max_tree_depth=6, seed=0)
    assert z.shape == (2, problem.unknowns)
    assert np.all(np.isfinite(np.asarray(settled.log_density(z))))
    # In these units the posterior is about standard normal: points are as far as such are.
    assert np.all(np.abs(np.linalg.norm(z, axis=1) - np.sqrt(problem.unknowns)) < 3.0)
    data, L = settled.training.data, settled.transform.factor
    at = [
        hessian_at(settled.target, np.asarray(settled.transform.mode + L @ one), data) for one in z
    ]
    curvature = np.linalg.eigvalsh(L.T @ np.mean(at, axis=0) @ L)
    assert 0.3 < curvature.min() < curvature.max() < 3.0


def test_a_point_is_turned_towards_another_and_is_the_same_but_for_that(grams):
    model = Turned()
    problem = sampling_problem(model, model.prepare(grams), 0, "typical")
    random = np.random.default_rng(4)
    x = random.normal(size=(POINTS, SIZE))
    middle = np.asarray(problem.transform.mode)
    near = rotated(problem.target, x.ravel(), middle).reshape(POINTS, SIZE)
    np.testing.assert_allclose(near @ near.T, x @ x.T)
    S = near.T @ middle.reshape(POINTS, SIZE)
    np.testing.assert_allclose(S, S.T, atol=1e-12)
    assert np.abs(near - x).max() > 0.1


def test_a_settled_run_goes_on_as_it_would_have(grams, tmp_path):
    settings = {"warmup": 200, "chains": 2, "seed": 3, "start": "typical"}
    whole = fit_nuts(Turned(), grams, draws=100, **settings)
    part = tmp_path / "run.part"
    fit_nuts(Turned(), grams, draws=40, checkpoint=part, **settings)
    rest = fit_nuts(Turned(), grams, draws=100, checkpoint=part, resume=True, **settings)
    np.testing.assert_array_equal(whole.tree["posterior"]["x"], rest.tree["posterior"]["x"])
