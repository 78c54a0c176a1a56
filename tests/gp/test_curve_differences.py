"""The posterior of a difference of curves: by brute force at one phase, by simulation at many."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpyro.infer.util import log_density
from scipy.stats import kstest

from bayesmotion.gp.curve_differences import (
    NU,
    TAU2,
    People,
    correlation_of,
    difference,
    program,
)


def people(value, strides=None, within=None, freedom=None, **rest):
    n, phases = value.shape
    none = np.zeros((1, phases))
    return People(
        value, rest.pop("design", np.ones((n, 1))), rest.pop("asked", np.ones(1)),
        np.zeros((n, 1, phases)) if strides is None else strides,
        none if within is None else within, none if freedom is None else freedom,
        rest.pop("group", np.zeros(n, dtype=int)), **rest,
    )  # fmt: skip


def fields(random, shape, waves=6, phases=51):
    t = np.linspace(0.0, np.pi, phases)
    basis = np.stack([np.cos(k * t) for k in range(waves)])
    return random.normal(size=(*shape, waves)) @ basis / np.sqrt(0.5 * (waves + 1))


def test_at_one_phase_it_is_the_posterior_of_the_program():
    value = np.array([[0.3], [1.1], [0.4], [2.0], [1.2]])
    given = people(value)
    found = difference(given, 4000, np.random.default_rng(0))
    B = np.linspace(-3.0, 5.0, 81)
    log_precision, log_nu = np.linspace(-7.0, 5.0, 61), np.linspace(*np.log(NU[[0, -1]]), 12)
    log_tau2 = np.log(given.scale) + np.linspace(*np.log(TAU2[[0, -1]]), 24)

    @jax.jit
    @jax.vmap
    def density(b, precision, nu, tau2):
        sites = {"B": jnp.array([[b]]), "precision": jnp.exp(precision)[None],
                 "nu": jnp.exp(nu), "tau2": jnp.exp(tau2)}  # fmt: skip
        value, _ = log_density(program, (given, np.ones((1, 1)), given.scale), {}, sites)
        return value + precision + nu + tau2

    grid = np.meshgrid(B, log_precision, log_nu, log_tau2, indexing="ij")
    log_p = np.asarray(density(*(part.ravel() for part in grid))).reshape(grid[0].shape)
    share = np.exp(log_p - log_p.max()).sum(axis=(1, 2, 3))
    cdf = np.cumsum(share / share.sum()) - 0.5 * share / share.sum()
    told = kstest(found.draws[:, 0], lambda b: np.interp(b, B, cdf))
    assert told.statistic < 2.2 / np.sqrt(4000)
    # Were the variance known, it would be told apart: so few people have longer tails.
    normal = np.random.default_rng(1).normal(found.mean, value.std(ddof=1) / np.sqrt(5), 4000)
    assert kstest(normal, lambda b: np.interp(b, B, cdf)).statistic > 2.4 / np.sqrt(4000)


def test_the_band_holds_at_all_phases_together_with_six_people():
    random, errs, pointwise, runs = np.random.default_rng(3), 0, 0, 60
    for _ in range(runs):
        found = difference(people(fields(random, (6,))), 800, random)
        away = np.abs(found.draws - found.mean) / found.sd
        truth = (np.abs(found.mean) / found.sd).max()
        errs += truth > np.quantile(away.max(axis=1), 0.95)
        pointwise += truth > np.quantile(away, 0.95)
    assert errs <= runs * 0.05 + 2.0 * np.sqrt(runs * 0.05 * 0.95)
    # A control: what holds at each phase does not hold at all.
    assert pointwise > 2 * runs * 0.05 + 3.0 * np.sqrt(runs * 0.05 * 0.95)


def test_variances_that_change_over_phase_are_not_taken_for_alike():
    random = np.random.default_rng(0)
    wave = np.linspace(0.2, 3.0, 51)
    alike, unlike = (
        difference(people(fields(random, (8,)) * sd), 50, random) for sd in (1.0, wave)
    )
    assert alike.nu > 10.0 > 4.0 > unlike.nu
    assert unlike.people_sd[-1] > 4.0 * unlike.people_sd[0]
    assert 0.6 < alike.people_sd[-1] / alike.people_sd[0] < 1.6


def test_people_of_few_strides_count_less():
    random, phases = np.random.default_rng(1), 30
    value = np.zeros((6, phases))
    value[0] = 12.0
    strides = np.full((6, 1, phases), 0.02)
    strides[0] = 1.0
    value += 0.3 * random.normal(size=(6, 1))
    freedom = np.full((1, phases), 200.0)
    told = difference(people(value, strides, 100.0 * freedom, freedom), 200, random)
    alike = difference(people(value), 200, random)
    assert np.all(told.mean < 0.4 * alike.mean)
    np.testing.assert_allclose(told.stride_sd, 10.0, rtol=0.02)


def test_correlation_on_a_circle_goes_round():
    random = np.random.default_rng(0)
    t = np.arange(60) * 2.0 * np.pi / 60
    waves = np.concatenate([np.cos(np.outer(np.arange(4), t)), np.sin(np.outer(np.arange(4), t))])
    residual = random.normal(size=(50, 8)) @ waves
    around, along = correlation_of(residual, True), correlation_of(residual, False)
    assert around[0, -1] > 0.8 > 0.01 > along[0, -1]
    assert np.linalg.eigvalsh(around).min() > -1e-8
    np.testing.assert_allclose(np.diag(around, 5), np.corrcoef(residual.T).diagonal(5), atol=0.3)


@pytest.mark.parametrize("apart", [0.0, 2.0])
def test_groups_of_other_sds_are_told_apart(apart):
    random = np.random.default_rng(4)
    group = np.repeat([0, 1], 10)
    value = fields(random, (20,)) * np.exp(apart * group)[:, None]
    found = difference(
        people(value, design=np.eye(2)[group], asked=np.array([1.0, -1.0]), group=group), 50, random
    )
    assert (found.ratio > 2.0) == (apart > 0.0)
