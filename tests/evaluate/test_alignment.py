"""Draws that differ only by what no data can tell come together; others do not."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
import xarray as xr
from scipy.stats import ortho_group

from bayesmotion.evaluate.alignment import (
    align_permutations,
    align_phases,
    align_rotations,
    aligned,
)
from bayesmotion.fit import Fit


def spread(draws: np.ndarray) -> float:
    flat = draws.reshape(-1, *draws.shape[2:])
    return float(np.abs(flat - flat.mean(axis=0)).max())


def test_turned_and_reflected_points_come_together():
    random = np.random.default_rng(0)
    x = random.normal(size=(7, 3))
    turned = np.stack(
        [[x @ ortho_group.rvs(3, random_state=random) for _ in range(6)] for _ in range(2)]
    )
    assert spread(turned) > 1.0
    aligned = align_rotations(turned)
    assert spread(aligned) < 1e-9
    np.testing.assert_allclose(aligned[0, 0] @ aligned[0, 0].T, x @ x.T, atol=1e-9)


def test_points_of_another_shape_stay_apart():
    random = np.random.default_rng(1)
    x, other = random.normal(size=(2, 7, 3))
    aligned = align_rotations(np.stack([x, other])[None])
    assert spread(aligned) > 0.3


def test_phases_shifted_together_come_together_whichever_way_time_runs():
    random = np.random.default_rng(4)
    phase, step = random.uniform(-np.pi, np.pi, 5), random.uniform(0.1, 0.3, 5)
    sign = random.choice([-1.0, 1.0], size=(2, 10, 1))
    shift = random.uniform(-np.pi, np.pi, size=(2, 10, 1))
    phases, steps = align_phases(sign * phase + shift, sign * step)
    assert spread(phases) < 1e-9
    assert spread(steps) < 1e-12
    # What does not change: the differences between clips, up to the direction of time.
    turned = np.sign(steps[0, 0, 0])
    found = np.exp(1j * turned * (phases[0, 0] - phases[0, 0, 0]))
    np.testing.assert_allclose(found, np.exp(1j * (phase - phase[0])), atol=1e-9)


def test_a_clip_that_moves_by_itself_is_not_aligned_away():
    phase = np.zeros((1, 4, 3))
    phase[0, :, 2] = [0.0, 0.4, -0.4, 0.2]
    phases, _ = align_phases(phase + np.array([0.0, 1.0, 2.0, 3.0])[:, None], np.ones((1, 4, 3)))
    differences = phases[0, :, 2] - phases[0, :, 1]
    np.testing.assert_allclose(differences, [0.0, 0.4, -0.4, 0.2], atol=1e-9)


@dataclass(frozen=True)
class Plain:
    """What a fit asks of its model, without sites."""

    name: ClassVar[str] = "plain"

    def prepare(self, recordings, trained=None):
        pytest.fail("draws are aligned without it")

    def program(self, data):
        pytest.fail("draws are aligned without it")

    def initial_values(self, data, seed, count, trained=None):
        pytest.fail("draws are aligned without it")

    def dims(self):
        return {}

    def coords(self, data):
        return {}


class Symmetric(Plain):
    """Says of its sites what they count up to, and no more."""

    name = "symmetric"
    rotations = ("x", "loading")
    free_scales = ("x",)
    permutations = ({"mean": (0,), "loading": (0,), "transition": (0, 1)},)
    phases = (("phase", "step"),)


def fit_of(model, sites: dict[str, np.ndarray]) -> Fit:
    """Give a fit with these draws (chain, draw, ...)."""
    arrays = {
        name: (("chain", "draw", *(f"{name}_{i}" for i in range(value.ndim - 2))), value)
        for name, value in sites.items()
    }
    return Fit(model, xr.Dataset(), xr.DataTree.from_dict({"posterior": xr.Dataset(arrays)}))


def moved_draws(random: np.random.Generator) -> dict[str, np.ndarray]:
    """Draws that differ by symmetries alone: a size, rotations, an order, a shift."""
    x, mean = random.normal(size=(9, 3)), random.normal(size=(4, 2))
    loading, transition = random.normal(size=(4, 5, 2)), random.uniform(size=(4, 4))
    phase, step = random.uniform(-3, 3, 5), random.uniform(0.1, 0.3, 5)
    draws: dict[str, list] = {"fixed": []}
    for index in range(12):
        order = random.permutation(4) if index else np.arange(4)
        turns = ortho_group.rvs(2, size=4, random_state=random)
        sign, shift = random.choice([-1.0, 1.0]), random.uniform(-3, 3)
        one = {
            "x": random.uniform(0.1, 9.0) * x @ ortho_group.rvs(3, random_state=random),
            "mean": mean[order],
            "loading": np.einsum("knq,kqr->knr", loading, turns)[order],
            "transition": transition[order][:, order],
            "phase": sign * phase + shift,
            "step": sign * step,
            "fixed": np.array(float(index)),
        }
        for name, value in one.items():
            draws.setdefault(name, []).append(value)
    return {name: np.stack(values).reshape(2, 6, *values[0].shape)
            for name, values in draws.items()}  # fmt: skip


def test_all_symmetries_a_model_names_are_undone():
    draws = moved_draws(np.random.default_rng(5))
    found = aligned(fit_of(Symmetric(), draws))
    for name in ("x", "mean", "loading", "transition", "phase", "step"):
        assert spread(draws[name]) > 0.1, name
        assert spread(found[name].values) < 1e-8, name
    np.testing.assert_array_equal(found["fixed"], draws["fixed"])
    # What is the same in any words stays: rows of transitions go with their means.
    one, other = draws["transition"][0, 0], found["transition"].values[1, 5]
    assert np.linalg.eigvals(other).real.max() == pytest.approx(np.linalg.eigvals(one).real.max())


def test_a_model_that_names_no_symmetry_keeps_its_draws():
    draws = moved_draws(np.random.default_rng(6))
    found = aligned(fit_of(Plain(), draws))
    for name, value in draws.items():
        np.testing.assert_array_equal(found[name], value)


def test_components_that_differ_stay_apart():
    """Draws of two different means are not the same in any order."""
    random = np.random.default_rng(7)
    draws = {"mean": np.stack([random.normal(size=(3, 2)) for _ in range(2)])[None]}
    assert spread(align_permutations(draws, {"mean": (0,)})["mean"]) > 0.2
