"""Synthetic walkers: multilinear as promised, with a truth that is told."""

import numpy as np
import pytest
import xarray as xr

from bayesmotion.errors import InputError
from bayesmotion.motion import check, clips, split
from bayesmotion.motion.synthetic.gaits import fourier_basis
from bayesmotion.motion.synthetic.walkers import Truth, synthetic_truth, synthetic_walkers

FOUR = ("ann", "ben", "cas", "dee")
EVERY = ("walk", "run", "stride", "jog", "stroll")


@pytest.fixture(scope="module")
def truth() -> Truth:
    return synthetic_truth()


@pytest.fixture(scope="module")
def wide() -> Truth:
    """Make a grid large enough for ranks to mean something, with frames close together."""
    return synthetic_truth(FOUR, EVERY, styles=2, seconds=1.6, frame_rate=120.0)


@pytest.fixture(scope="module")
def walkers() -> xr.Dataset:
    return synthetic_walkers()


def phase_of(truth: Truth, clip: str) -> np.ndarray:
    return truth.phase.values[truth.phase["clip"].values == clip]


def fourier(motion: xr.Dataset, truth: Truth) -> dict[tuple[str, str], np.ndarray]:
    """Recover the Fourier coefficients (term, dof) of each cell from its angles alone."""
    cells = {}
    for clip, part in split(motion).items():
        basis = fourier_basis(phase_of(truth, clip))
        solution = np.linalg.lstsq(basis, part["angle"].values, rcond=None)[0]
        cells[str(part["subject"].values[0]), str(part["gait"].values[0])] = solution
    return cells


@pytest.fixture(scope="module")
def cells(wide: Truth) -> dict[tuple[str, str], np.ndarray]:
    return fourier(wide.motion, wide)


def grid(cells: dict, subjects: tuple, gaits: tuple) -> np.ndarray:
    return np.array([[cells[s, g].ravel() for g in gaits] for s in subjects])


def combined(cells: dict, person: str, others: list[str], known: tuple, wanted: str) -> np.ndarray:
    """Predict a cell as the combination of others that explains the person's known gaits."""
    theirs = np.stack([np.concatenate([cells[o, g].ravel() for g in known]) for o in others], 1)
    own = np.concatenate([cells[person, g].ravel() for g in known])
    weights = np.linalg.lstsq(theirs, own, rcond=None)[0]
    return sum(w * cells[o, wanted] for w, o in zip(weights, others, strict=True))


def test_the_motion_is_labelled_and_clean(walkers: xr.Dataset) -> None:
    assert clips(walkers)[:4] == ["ann-walk", "ann-run", "ann-stride", "ben-walk"]
    assert walkers.sizes["frame"] == 9 * 120
    assert set(walkers["gait"].values) == {"walk", "run", "stride"}
    assert np.isfinite(walkers["angle"]).all()
    assert check(walkers.isel(frame=walkers["subject"].values == "ann")) == []


def test_coefficients_are_what_the_angles_show(wide: Truth, cells: dict) -> None:
    for (subject, gait), seen in cells.items():
        told = wide.coefficient.sel(subject=subject, gait=gait).transpose("term", "dof")
        np.testing.assert_allclose(seen, told, atol=1e-9)


def check_ranks(tensor: np.ndarray, rank: int) -> None:
    people, modes = tensor.reshape(len(tensor), -1), tensor.swapaxes(0, 1).reshape(len(EVERY), -1)
    assert np.linalg.matrix_rank(people, tol=1e-8) == rank < len(tensor)
    assert np.linalg.matrix_rank(modes, tol=1e-8) == 3
    # The last direction is a style that can be seen, not rounding.
    assert np.linalg.svd(people, compute_uv=False)[rank - 1] > 0.05


def test_the_tensor_has_small_rank_in_every_mode(wide: Truth, cells: dict) -> None:
    check_ranks(grid(cells, FOUR, EVERY), 3)
    assert np.linalg.matrix_rank(wide.step.values, tol=1e-12) <= 3


def test_a_single_style_has_rank_two() -> None:
    names = FOUR[:3]
    truth = synthetic_truth(names, EVERY, styles=1, seconds=2.5)
    check_ranks(grid(fourier(truth.motion, truth), names, EVERY), 2)
    assert np.linalg.matrix_rank(truth.step.values, tol=1e-12) <= 2


def test_style_and_gait_interact(truth: Truth) -> None:
    """People are not merely shifted: what sets two apart differs from gait to gait."""
    apart = truth.coefficient.sel(subject="ann") - truth.coefficient.sel(subject="cas")
    assert abs(apart.sel(gait="walk") - apart.sel(gait="run")).max() > 0.02


def test_a_cell_left_out_is_determined_by_the_others(truth: Truth) -> None:
    data = synthetic_walkers(leave_out=[("ann", "run")], noise=0.0)
    assert "ann-run" not in clips(data)
    assert len(clips(data)) == 8
    found = combined(fourier(data, truth), "ann", ["ben", "cas"], ("walk", "stride"), "run")
    shown = fourier_basis(phase_of(truth, "ann-run")) @ found
    np.testing.assert_allclose(shown, truth.cell("ann", "run")["angle"], atol=1e-8)


def test_two_styles_need_three_others(cells: dict) -> None:
    for others, determined in ((["ben", "cas", "dee"], True), (["ben", "cas"], False)):
        found = combined(cells, "ann", others, ("walk", "stride"), "run")
        assert (abs(found - cells["ann", "run"]).max() < 1e-8) == determined


def test_left_out_cells_and_noise_touch_nothing_else(walkers: xr.Dataset, truth: Truth) -> None:
    fewer = synthetic_walkers(leave_out=[("ben", "walk"), ("cas", "stride")])
    kept = np.isin(walkers["clip"].values, clips(fewer))
    assert kept.sum() == 7 * 120
    np.testing.assert_array_equal(fewer["angle"], walkers["angle"][kept])
    np.testing.assert_array_equal(fewer["root_position"], walkers["root_position"][kept])
    np.testing.assert_array_equal(walkers["root_position"], truth.motion["root_position"])


def test_noise_is_as_large_as_asked_for(walkers: xr.Dataset, truth: Truth) -> None:
    error = (walkers["angle"] - truth.motion["angle"]).values
    count = error.size
    # Five standard errors of a mean and of a standard deviation.
    assert abs(error.mean()) < 5 * 0.01 / count**0.5
    assert abs(error.std() / 0.01 - 1) < 5 / (2 * count) ** 0.5
    after = np.mean(error[1:] * error[:-1]) / 0.01**2
    assert abs(after) < 5 / count**0.5
    exact = synthetic_walkers(noise=0.0)
    np.testing.assert_array_equal(exact["angle"], truth.motion["angle"])


def test_the_same_seed_gives_the_same_motion(walkers: xr.Dataset) -> None:
    xr.testing.assert_identical(walkers, synthetic_walkers())
    one = {"subjects": ("ann",), "gaits": ("walk",)}
    first, second = (synthetic_walkers(**one, seed=seed)["angle"] for seed in (0, 1))
    assert abs(first - second).max() > 0.1


def test_phases_advance_by_the_step_from_a_heel_strike(truth: Truth) -> None:
    for clip, part in split(truth.motion).items():
        subject, gait = clip.split("-")
        step = float(truth.step.sel(subject=subject, gait=gait))
        np.testing.assert_allclose(np.diff(phase_of(truth, clip)), step, rtol=1e-9)
        cycle = phase_of(truth, clip) % (2 * np.pi)
        hip = -part["angle"].sel(dof="lfemur/rx").values
        # The left leg is in front at 0 and behind at half the cycle.
        assert hip[np.cos(cycle) > 0.9].mean() > 0.25 > 0.1 > hip[np.cos(cycle) < -0.9].mean()


def test_every_setting_does_something(truth: Truth) -> None:
    def angle(**settings) -> np.ndarray:
        return synthetic_truth(**settings).motion["angle"].values

    usual = angle(subjects=("ann", "ben"), gaits=("walk",))
    assert angle(subjects=("ann", "ben"), gaits=("walk",), seconds=2.0).shape[0] == 120
    fine = angle(subjects=("ann", "ben"), gaits=("walk",), frame_rate=60.0)
    np.testing.assert_allclose(fine[::2], usual, atol=1e-9)
    assert abs(angle(subjects=("ann", "ben"), gaits=("jog",)) - usual).max() > 0.5
    other = synthetic_truth(FOUR[:3], ("walk",), styles=2).subject_vector
    assert abs(other - truth.subject_vector).max() > 0.1
    assert len(set(truth.stature.values.tolist())) == 3


def test_people_differ_by_more_than_the_noise(truth: Truth) -> None:
    """Otherwise nobody could be recognised."""
    tensor = grid(fourier(truth.motion, truth), FOUR[:3], EVERY[:3])
    for i, j in ((0, 1), (0, 2), (1, 2)):
        assert np.abs(tensor[i] - tensor[j]).max(axis=-1).min() > 0.03


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"subjects": ()}, "subjects: .*at least one"),
        ({"subjects": ("ann", "ann")}, "subjects: .*different names"),
        ({"gaits": "walk"}, "gaits: they are 'walk'"),
        ({"gaits": ("walk", "swim")}, "gait 'swim': .*jog"),
        ({"leave_out": [("dan", "run")]}, r"cell \('dan', 'run'\): it is not in the grid"),
        ({"subjects": ("ann",), "gaits": ("run",), "leave_out": [("ann", "run")]}, "no cell"),
        ({"seconds": 0.03}, "seconds: that makes 1 frames"),
        ({"seconds": float("nan")}, "seconds: it is nan"),
        ({"frame_rate": -30.0}, "frame_rate: it is -30"),
        ({"noise": -0.1}, "noise: it is -0.1"),
        ({"styles": 3}, "styles: it is 3"),
        ({"seed": -1}, "seed: it is -1"),
    ],
)
def test_settings_that_cannot_be_used(settings: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        synthetic_walkers(**settings)


def test_cells_the_truth_does_not_have(truth: Truth) -> None:
    with pytest.raises(InputError, match="not in the grid"):
        truth.cell("ann", "jog")
