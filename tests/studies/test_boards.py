"""Boards: methods see contexts alone, files are scored, and simple forecasts are what they say."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.prediction import Mixture
from bayesmotion.studies.boards.baselines import cycle_method, hold, nearest, with_sd, zero
from bayesmotion.studies.boards.channels import channel_motion
from bayesmotion.studies.boards.harness import (
    Board,
    clip_scores,
    forecasts,
    score_file,
    summary,
    thinned,
    write_given,
)
from bayesmotion.studies.boards.multifactor import residual_axes, turned_back

PERIOD, FRAMES, CONTEXT = 24.0, 60, 3


def walk(phase, period, seed):
    random = np.random.default_rng(seed)
    theta = phase + 2 * np.pi * np.arange(FRAMES) / period
    waves = np.stack([np.cos(theta), np.sin(theta), np.cos(2 * theta), 0.0 * theta], axis=1)
    return waves * [20.0, 10.0, 5.0, 0.0] + random.normal(size=(FRAMES, 4)) * [1, 1, 1, 0]


@pytest.fixture(scope="module")
def board():
    train = {f"train {i}": walk(i, PERIOD * (1 + 0.02 * (i % 3 - 1)), i) for i in range(6)}
    test = {f"test {i}": walk(0.7 + i, PERIOD, 50 + i) for i in range(3)}
    return Board("example", train, test, CONTEXT, 24.0)


def normal(board, mean, sd=1.0):
    return Mixture(mean[None], np.full((1, *mean.shape), sd), np.ones(1))


def test_a_method_sees_copies_of_the_contexts_and_nothing_else(board):
    seen = []

    def method(context, horizon):
        assert context.base is None
        assert horizon == FRAMES - CONTEXT
        seen.append(context.copy())
        context[:] = np.nan
        return normal(board, np.zeros((horizon, 4)))

    told = forecasts(board, method)
    assert list(told) == list(board.test)
    for context, clip in zip(seen, board.test.values(), strict=True):
        np.testing.assert_array_equal(context, clip[:CONTEXT])
        assert np.isfinite(clip).all()


def test_forecasts_of_other_frames_than_those_to_predict_are_refused(board):
    def all_frames(context, horizon):
        return normal(board, np.zeros((horizon + CONTEXT, 4)))

    with pytest.raises(InputError, match="Predict 57 frames of 4 columns"):
        forecasts(board, all_frames)
    with pytest.raises(InputError, match="not finite"):
        forecasts(board, lambda context, horizon: normal(board, np.full((horizon, 4), np.nan)))


def test_scores_of_a_normal_forecast_are_those_of_its_formula(board):
    random, clip = np.random.default_rng(0), "test 0"
    true = board.test[clip][CONTEXT:]
    mean = true + 2.0 * random.normal(size=true.shape)
    scores = clip_scores(board, clip, normal(board, mean, 2.0))
    assert scores["mse"] == pytest.approx(np.mean((mean - true) ** 2))
    # Three columns move: 171 entries, whose central intervals hold as often as they say.
    for share in (0.5, 0.8, 0.9, 0.95):
        error = np.sqrt(share * (1 - share) / 171)
        assert abs(scores[f"coverage{100 * share:.0f}"] - share) < 4 * error
    z = ((mean - true) / 2.0)[:, :3]
    log_score = np.mean(-0.5 * z**2 - np.log(2.0) - 0.5 * np.log(2 * np.pi))
    assert scores["log_score"] == pytest.approx(log_score)
    assert set(clip_scores(board, clip, normal(board, mean), spread=False)) == {"mse"}


def test_a_file_of_predictions_is_scored_as_the_method_that_made_it(board, tmp_path):
    def method(context, horizon):
        mean = np.repeat(context[-1:], horizon, axis=0)
        return Mixture(
            np.stack([mean, mean + 1.0]), np.full((2, horizon, 4), 9.0), np.array([0.3, 0.7])
        )

    told = forecasts(board, method)
    arrays = {}
    for name, one in told.items():
        arrays |= {f"{name}/mean": one.mean, f"{name}/sd": one.sd, f"{name}/weight": one.weight}
    np.savez(tmp_path / "told.npz", **arrays)
    direct = {name: clip_scores(board, name, one) for name, one in told.items()}
    assert score_file(board, tmp_path / "told.npz")["clips"] == direct
    only = {name: array for name, array in arrays.items() if name.endswith("mean")}
    np.savez(tmp_path / "means.npz", **{n: a.mean(axis=0) for n, a in only.items()})
    assert set(score_file(board, tmp_path / "means.npz")["over_clips"]) == {"mse"}
    del arrays["test 1/mean"]
    np.savez(tmp_path / "lacking.npz", **arrays)
    with pytest.raises(InputError, match="test 1/mean"):
        score_file(board, tmp_path / "lacking.npz")


def test_what_is_given_to_others_has_no_frame_to_predict(board, tmp_path):
    write_given(board, tmp_path / "given.npz")
    with np.load(tmp_path / "given.npz") as stored:
        for name, clip in board.test.items():
            np.testing.assert_array_equal(stored[f"context/{name}"], clip[:CONTEXT])
            assert stored[f"horizon/{name}"] == FRAMES - CONTEXT
            assert not any(array.shape == clip.shape and np.array_equal(array, clip)
                           for array in stored.values())  # fmt: skip


def test_a_summary_has_the_standard_error_over_clips():
    clips = {str(i): {"mse": float(i)} for i in range(5)}
    one = summary(clips)["mse"]
    assert one["mean"] == 2.0
    assert one["se"] == pytest.approx(np.std(range(5), ddof=1) / np.sqrt(5))
    assert one["interval"][0] < 2.0 < one["interval"][1]


def test_a_thinned_mixture_keeps_its_mean():
    random = np.random.default_rng(0)
    weight = random.dirichlet(np.ones(400))
    whole = Mixture(random.normal(size=(400, 3, 2)), np.ones((400, 3, 2)), weight)
    few = thinned(whole, 100)
    assert len(few.weight) == 100
    assert np.abs(few.means() - whole.means()).max() < 4 * np.sqrt(1 / 100)
    assert thinned(few, 100) is few


def test_cycles_forecast_better_than_poses_and_say_how_well(board):
    horizon, errors = FRAMES - CONTEXT, {}
    methods = {name.__name__: with_sd(name, board.train, horizon, CONTEXT)
               for name in (hold, zero, nearest)}  # fmt: skip
    methods |= {str(mixed): cycle_method(board.train, 24.0, mixed=mixed) for mixed in (False, True)}
    for name, method in methods.items():
        told = forecasts(board, method)
        clips = {clip: clip_scores(board, clip, one) for clip, one in told.items()}
        errors[name] = summary(clips)
    for name in ("False", "True"):
        assert errors[name]["mse"]["mean"] < 0.3 * errors["zero"]["mse"]["mean"]
        assert errors[name]["coverage90"]["mean"] > 0.7
        assert errors[name]["log_score"]["mean"] > errors["hold"]["log_score"]["mean"]


def test_axes_are_those_in_which_deviations_are_uncorrelated(board):
    axes = residual_axes(board.train, 24.0)
    np.testing.assert_allclose(axes.T @ axes, np.eye(4), atol=1e-12)
    random = np.random.default_rng(0)
    mean, sd = random.normal(size=(2, 5, 4)), random.uniform(0.1, 1.0, size=(2, 5, 4))
    told = turned_back(Mixture(mean, sd, np.array([0.4, 0.6])), axes)
    draws = mean[0, 3] + sd[0, 3] * random.normal(size=(40_000, 4))
    turned = np.degrees(draws) @ axes.T
    error = told.sd[0, 3] / 200.0
    assert (np.abs(turned.mean(axis=0) - told.mean[0, 3]) < 4 * error).all()
    np.testing.assert_allclose(turned.std(axis=0), told.sd[0, 3], rtol=0.02)


def test_channels_are_motions_of_degrees(board):
    motion = channel_motion(board.test, 24.0, {"test 0": {"take": "a"}})
    clip = motion.isel(frame=motion["clip"].values == "test 0")
    np.testing.assert_allclose(np.degrees(clip["angle"].values[:, 3:]), board.test["test 0"])
    assert not clip["angle"].values[:, :3].any()
    assert set(clip["take"].values) == {"a"}
