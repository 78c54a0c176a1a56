"""Forecasts: better than plain ones, blind to the future, on any trained model."""

import dataclasses
import json
import warnings

import jax
import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.fit import Fit
from bayesmotion.inference.methods import MAP, fit
from bayesmotion.inference.modes import trained_model
from bayesmotion.inference.predicting import ALIKE, MIXTURES
from bayesmotion.models.multifactor import GPDynamics, Multifactor
from bayesmotion.models.multifactor.settings import SUBJECT_AND_GAIT
from bayesmotion.motion import downsample, positions, skeleton_of, split, write
from bayesmotion.motion.joining import lengthened
from bayesmotion.motion.resampling import at_rate
from bayesmotion.motion.synthetic.walkers import synthetic_truth
from bayesmotion.tasks import baselines
from bayesmotion.tasks.cautions import training_clip
from bayesmotion.tasks.forecast import angle_error, angles_of, forecast
from bayesmotion.tasks.forecast_scores import forecast_scores
from bayesmotion.tasks.outcome import anatomy_of_motion
from bayesmotion.tasks.synthesise import synthesize

pytestmark = pytest.mark.slow

CONTEXT, HORIZON = 16, 20


@pytest.fixture(scope="module")
def unseen():
    """The clip that was left out of the training, without noise."""
    known = synthetic_truth(gaits=("walk", "run"), seconds=2.0, frame_rate=20.0)
    return known.cell("ben", "run")


@pytest.fixture(scope="module")
def predicted(circle_fit, unseen):
    return forecast(circle_fit, unseen, context=CONTEXT, horizon=HORIZON)


def test_an_unrecorded_cell_is_forecast_better_than_by_holding_the_pose(
    circle_fit, unseen, predicted
):
    encoding = circle_fit.training.encoding
    heading = encoding.heading(unseen.isel(frame=slice(CONTEXT)))
    features = encoding.features(unseen, heading)[:, : encoding.n_angles]
    held = baselines.hold(features[:CONTEXT], HORIZON)
    true = features[CONTEXT : CONTEXT + HORIZON]
    found = forecast_scores(circle_fit, unseen, predicted)
    assert found is not None
    error = angle_error(predicted.mean[CONTEXT:, : encoding.n_angles], true)
    np.testing.assert_allclose(found.per_frame, error, rtol=1e-9)
    assert found.error == pytest.approx(error.mean())
    assert found.baselines["hold"] == pytest.approx(angle_error(held, true).mean())
    assert found.error < 0.5 * found.baselines["hold"]
    assert set(found.scores.coverage) == {0.5, 0.8, 0.9, 0.95}
    assert predicted.motion.sizes["frame"] == CONTEXT + HORIZON
    assert np.all(predicted.sd > 0)
    # Of the clip nothing is to be said; its fit is short.
    assert [text[:29] for text in predicted.messages] == ["the fit has not converged: go"]


def test_the_motion_begins_with_the_frames_of_the_context(unseen, predicted):
    past = unseen.isel(frame=slice(CONTEXT))
    shown = positions(predicted.motion).isel(frame=slice(CONTEXT))
    apart = np.abs(shown.values - positions(past).sel(joint=shown["joint"]).values)
    # Joints that are left out of the features stand at their mean.
    assert np.median(apart) < 1e-6
    (drawn,) = predicted.draws(1)
    np.testing.assert_allclose(
        drawn["angle"].values[:CONTEXT], predicted.motion["angle"].values[:CONTEXT], atol=1e-9
    )
    assert np.abs(drawn["angle"].values - predicted.motion["angle"].values)[CONTEXT:].max() > 1e-3


def test_a_forecast_does_not_look_at_the_future(circle_fit, unseen, predicted):
    short = unseen.isel(frame=slice(CONTEXT))
    blind = forecast(circle_fit, short, context=CONTEXT, horizon=HORIZON)
    np.testing.assert_array_equal(predicted.mean, blind.mean)


def test_uncertainty_grows_away_from_the_context(circle_fit, unseen, predicted):
    """Every angle's at the mode; of an unknown phase an angle is also the surer where it rests."""
    angles = circle_fit.training.encoding.n_angles
    mode = forecast(at_the_mode(circle_fit), unseen, context=CONTEXT, horizon=HORIZON)
    assert np.all(mode.sd[CONTEXT + 8, :angles] > mode.sd[CONTEXT, :angles])
    near, far = predicted.sd[CONTEXT, :angles], predicted.sd[CONTEXT + 8, :angles]
    assert np.mean(far / near) > 1.0


def test_a_known_label_is_used(circle_fit, unseen):
    known = forecast(
        circle_fit, unseen, context=CONTEXT, horizon=HORIZON,
        labels={"subject": "ben", "gait": "run"},
    )  # fmt: skip
    assert "style_subject" not in known.values
    assert "style_gait" not in known.values


def at_the_mode(fit):
    """Return a fit that takes a new clip's unknowns at their modes."""
    return dataclasses.replace(fit, model=dataclasses.replace(fit.model, unknown_draws=0))


def test_a_forecast_averages_over_draws_of_the_unknowns(circle_fit, predicted):
    """They are spread about the mode, as many as the setting says of every mode."""
    steps, weight = predicted.prediction.unknowns["step"][:, 0], predicted.prediction.weight
    assert len(weight) % circle_fit.model.unknown_draws == 0
    assert np.unique(steps).size > len(weight) // 3
    mean = float(weight @ steps)
    sd = float(np.sqrt(weight @ (steps - mean) ** 2))
    assert sd > 0.0
    assert abs(float(predicted.values["step"][0]) - mean) < 3.0 * sd


def test_modes_that_predict_the_same_are_one(circle_fit, unseen):
    # As many frames in all as of `predicted`: what is compiled for that serves here.
    short = forecast(at_the_mode(circle_fit), unseen, context=8, horizon=CONTEXT + HORIZON - 8)
    weight, parts = short.mixture.weight, len(short.mixture.weight) // len(short.prediction.weight)
    mean = short.mixture.mean[::parts]
    assert weight.sum() == pytest.approx(1.0)
    for one in range(len(mean)):
        for other in range(one):
            apart = np.abs(mean[one] - mean[other]) / circle_fit.training.encoding.sd
            assert np.max(apart) > 0.9 * ALIKE
    within = np.tensordot(weight, short.mixture.sd**2, 1)
    assert np.all(short.sd**2 >= within * (1.0 - 1e-9))


def test_a_t_process_is_a_mixture_also_of_a_single_draw(circle_fit, unseen):
    """Its mean variance is the exact one, but for the randomness of so many parts."""
    predicted = forecast(at_the_mode(circle_fit), unseen, context=CONTEXT, horizon=HORIZON)
    weight, mixture = predicted.prediction.weight, predicted.mixture
    parts, best = len(mixture.weight) // len(weight), int(np.argmax(weight))
    assert parts == MIXTURES
    (frames,) = predicted.prediction.data.data
    model = circle_fit.model
    trained = trained_model(model, *circle_fit.training.data, circle_fit.values())
    exact = jax.jit(model.predict)(trained, frames, predicted.values)["y"].variance
    own = mixture.sd[best * parts : (best + 1) * parts] ** 2
    ratio = own.mean(axis=0) / (np.asarray(exact) * circle_fit.training.encoding.sd**2)
    shape = 0.5 * (circle_fit.model.student_df + CONTEXT)
    error = 1.0 / np.sqrt((shape - 2.0) * parts)
    assert np.abs(ratio - 1.0).max() < 5.0 * error
    # A single part would be off by more than that.
    assert np.abs(own[0] / own.mean(axis=0) - 1.0).max() > 5.0 * error


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"context": 0, "horizon": 5}, "at least 1 frame"),
        ({"context": 400, "horizon": 5}, "the clip has 40"),
        ({"context": 10, "horizon": 0}, "at least 1"),
        ({"context": 10, "horizon": 5, "labels": {"gait": "fly"}}, "'fly' is not in the training"),
        ({"context": 10, "horizon": 5, "labels": {"mood": "sad"}}, "'sad' is not in the training"),
    ],
)
def test_bad_questions_get_a_sentence(circle_fit, unseen, settings, said):
    with pytest.raises(InputError, match=said):
        forecast(circle_fit, unseen, **settings)


@pytest.mark.parametrize(
    "rate", [*(pytest.param(rate, marks=pytest.mark.thorough) for rate in (40.0, 80.0)), 19.98]
)
def test_a_clip_of_another_frame_rate_is_forecast_alike(circle_fit, unseen, rate):
    # At the mode: draws of the unknowns differ by chance.
    circle_fit = at_the_mode(circle_fit)
    predicted = forecast(circle_fit, unseen, context=CONTEXT, horizon=HORIZON)
    known = synthetic_truth(gaits=("walk", "run"), seconds=2.0, frame_rate=rate)
    clip = known.cell("ben", "run")
    with pytest.warns(MotionWarning, match=f"clips of {rate:g} frames .* resampled to 20, the"):
        found = forecast(circle_fit, clip, context=CONTEXT, horizon=HORIZON)
    assert f"clips of {rate:g} frames a second were resampled to 20" in found.messages[0]
    assert found.motion.sizes["frame"] == CONTEXT + HORIZON
    assert found.motion.attrs["frame_rate"] == 20.0
    errors = [forecast_scores(circle_fit, unseen, one) for one in (predicted, found)]
    assert errors[1].error == pytest.approx(errors[0].error, rel=0.05)
    # What follows the context is not looked at.
    later = clip.copy(deep=True)
    last = int(np.ceil((CONTEXT - 1) * rate / 20.0))
    later["angle"][last + 1 :] = 0.0
    past, _ = at_rate(later, circle_fit.frame_rate, context=CONTEXT)
    whole, _ = at_rate(clip, circle_fit.frame_rate, context=CONTEXT)
    xr.testing.assert_equal(past, whole)


def test_a_clip_with_too_few_frames_at_the_rate_of_the_fit_is_refused(circle_fit, unseen):
    with pytest.raises(InputError, match=r"45 frames of context at 20 a second, .* has 20 at 10"):
        forecast(circle_fit, downsample(unseen, 2), context=45, horizon=5)


def test_a_training_clip_is_noticed_under_any_name(circle_fit, unseen):
    clip = split(circle_fit.motion)["ann-walk"]
    other = clip.assign_coords(clip=("frame", np.full(clip.sizes["frame"], "fresh")))
    with pytest.warns(MotionWarning, match="this clip trained the fit: 'fresh' is in it as 'ann-w"):
        known = forecast(circle_fit, other, context=CONTEXT, horizon=HORIZON)
    assert any("trained the fit" in message for message in known.messages)
    assert "trained the fit" in repr(known)
    # A later part of it, and what the fifth digit of a file has lost, are the same clip.
    part = clip.isel(frame=slice(4, 16))
    assert training_clip(circle_fit.motion, part.assign(angle=part["angle"] + 1e-5)) == "ann-walk"
    # Another clip of that name is none.
    namesake = unseen.assign_coords(clip=("frame", np.full(unseen.sizes["frame"], "ann-walk")))
    assert training_clip(circle_fit.motion, namesake) is None


def test_a_fit_that_has_not_converged_is_told_where_it_is_used(circle_fit, unseen):
    assert "not converged" in circle_fit.warnings
    with pytest.warns(MotionWarning, match="the forecast: the fit has not converged"):
        forecast(circle_fit, unseen, context=CONTEXT, horizon=HORIZON)
    with pytest.warns(MotionWarning, match="the motion: the fit has not converged"):
        synthesize(circle_fit, {"subject": "ann", "gait": "run"}, 0.5)


def test_several_clips_are_forecast_by_name(circle_fit, unseen, predicted):
    clips = {"one": unseen, "two": unseen.isel(frame=slice(2, None))}
    found = forecast(circle_fit, clips, context=CONTEXT, horizon=HORIZON)
    assert list(found) == ["one", "two"]
    np.testing.assert_array_equal(found["one"].mean, predicted.mean)
    assert not np.array_equal(found["two"].mean, predicted.mean)


def test_what_is_forecast_is_written_with_its_uncertainty(circle_fit, unseen, predicted, tmp_path):
    table = predicted.to_dataset()
    assert table.sizes["frame"] == HORIZON
    y = table.isel(channel=slice(predicted.mean.shape[1]))
    # Lengths are told in the unit of the clip.
    unit = circle_fit.training.in_units_of(skeleton_of(unseen))
    np.testing.assert_allclose(y["mean"], unit * predicted.mean[CONTEXT:])
    np.testing.assert_allclose(y["sd"], unit * predicted.sd[CONTEXT:])
    assert np.all(np.diff(table["quantiles"].values, axis=0) >= 0.0)
    knee = table.sel(channel="left knee flexion")
    assert str(knee["unit"].values) == "degrees"
    of_mean = anatomy_of_motion(predicted.motion)["left knee flexion"][CONTEXT:]
    assert np.all(np.abs(knee["mean"].values - of_mean) < 2.0 * knee["sd"].values)
    write(predicted, tmp_path / "f.csv")
    rows = pd.read_csv(tmp_path / "f.csv")
    assert list(rows) == [
        "clip", "time_s", "channel", "unit", "mean", "sd", "q05", "q25", "q50", "q75", "q95",
    ]  # fmt: skip
    assert len(rows) == table.sizes["frame"] * table.sizes["channel"]
    assert rows["time_s"].min() == pytest.approx(CONTEXT / 20.0)
    for _ in range(2):  # the second takes the place of the first
        write(predicted, tmp_path / "f.nc")
    np.testing.assert_array_equal(xr.load_dataset(tmp_path / "f.nc")["mean"], table["mean"])
    with pytest.raises(InputError, match=r"Use \.csv or \.nc"):
        write(predicted, tmp_path / "f.bvh")


def test_as_many_motions_are_drawn_as_are_asked_for(circle_fit, unseen):
    future = forecast(circle_fit, unseen, context=CONTEXT, horizon=HORIZON, samples=4)
    drawn = [one["angle"].values for one in future.draws(4)]
    assert len(drawn) == 4
    for one in drawn:
        np.testing.assert_allclose(one[:CONTEXT], drawn[0][:CONTEXT])
    ends = np.stack([one[CONTEXT:] for one in drawn])
    assert len(np.unique(ends[:, -1, 0])) == 4


def test_heading_that_is_taken_out_is_told_by_the_context(circle_fit, unseen):
    model = dataclasses.replace(circle_fit.model, align_heading=True)
    aligned = Fit(model, circle_fit.motion, circle_fit.tree)
    angles, columns = angles_of(aligned, unseen, CONTEXT)
    encoding = aligned.training.encoding
    heading = encoding.heading(unseen.isel(frame=slice(CONTEXT)))
    np.testing.assert_allclose(angles, encoding.features(unseen, heading)[:, columns], atol=1e-12)


def test_frames_of_which_nothing_is_known_follow(unseen):
    longer = lengthened(unseen.isel(frame=slice(5)), 3)
    assert longer.sizes["frame"] == 8
    assert longer["angle"].isel(frame=slice(5)).equals(unseen["angle"].isel(frame=slice(5)))
    assert np.isnan(longer["angle"].values[5:]).all()
    assert np.isnan(longer["root_position"].values[5:]).all()
    assert set(longer["clip"].values) == set(unseen["clip"].values)
    np.testing.assert_allclose(np.diff(longer["time"].values), 1.0 / unseen.attrs["frame_rate"])


@pytest.fixture(scope="module")
def drawn(circle_fit):
    """Six draws about a mode, and a warning that goes with them."""
    random, draws = np.random.default_rng(0), 6
    tree = circle_fit.tree.copy()
    posterior = tree["posterior"].to_dataset().isel(draw=np.zeros(draws, int))
    for name in ("gamma", "beta", "step", "scale"):
        size = np.exp(0.02 * random.normal(size=posterior[name].shape))
        posterior[name] = posterior[name] * size
    tree["posterior"] = xr.DataTree(posterior.assign_coords(draw=np.arange(draws)))
    tree.attrs["warnings"] = json.dumps(["too few to be trusted"])
    return Fit(circle_fit.model, circle_fit.motion, tree)


def test_draws_are_averaged_over_whatever_their_order(drawn, unseen):
    with pytest.warns(MotionWarning, match="the fit's draws: too few to be trusted"):
        one = forecast(drawn, unseen, context=CONTEXT, horizon=HORIZON)
    assert one.prediction.draws == 6
    assert np.ptp(one.mixture.mean, axis=0).max() > 0.0
    backwards = drawn.tree.copy()
    turned = drawn.tree["posterior"].to_dataset().isel(draw=slice(None, None, -1))
    backwards["posterior"] = xr.DataTree(turned)
    turned_fit = Fit(drawn.model, drawn.motion, backwards)
    with pytest.warns(MotionWarning):
        other = forecast(turned_fit, unseen, context=CONTEXT, horizon=HORIZON)
    np.testing.assert_allclose(other.mean, one.mean, atol=1e-9)
    np.testing.assert_allclose(other.sd, one.sd, atol=1e-9)


@pytest.mark.parametrize(
    ("content", "factors"),
    [
        pytest.param(GPDynamics(), SUBJECT_AND_GAIT, id="gp"),
        pytest.param(GPDynamics(balanced=True), (), id="balanced", marks=pytest.mark.thorough),
    ],
)
def test_paths_with_gaussian_process_dynamics_go_on(walkers, unseen, content, factors):
    model = Multifactor(content, factors=factors)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MotionWarning)
        path = fit(model, walkers, method=MAP(initial=1, keep=1, max_steps=20), seed=0)
        predicted = forecast(path, unseen, context=CONTEXT, horizon=6)
    assert predicted.mean.shape[0] == CONTEXT + 6
    assert predicted.values["x"].shape == (CONTEXT + 6, 3)
    assert np.all(np.isfinite(predicted.mean))
    moved = np.abs(np.diff(predicted.mean[CONTEXT - 1 :, :10], axis=0)).max(axis=1)
    assert np.all(moved > 0)


def test_a_clips_unknowns_are_found_in_the_frames_that_are_seen(circle_fit, unseen, monkeypatch):
    """As they would be with the frames to predict."""
    circle_fit = at_the_mode(circle_fit)
    said = forecast(circle_fit, unseen, context=CONTEXT, horizon=HORIZON)
    monkeypatch.setattr(Multifactor, "until_last_seen", lambda model, recordings: recordings)
    whole = forecast(circle_fit, unseen, context=CONTEXT, horizon=HORIZON)
    np.testing.assert_allclose(whole.mean, said.mean, atol=1e-4)
    np.testing.assert_allclose(whole.sd, said.sd, rtol=1e-3)


def test_plain_forecasts():
    y = np.arange(12.0).reshape(6, 2)
    np.testing.assert_array_equal(baselines.hold(y, 2), [[10.0, 11.0]] * 2)
    np.testing.assert_array_equal(baselines.constant_velocity(y, 2), [[12.0, 13.0], [14.0, 15.0]])
    wave = np.sin(np.arange(40.0) / 3.0)[:, None]
    going_on = baselines.nearest(wave[5:15], 8, {"a": -wave, "b": wave})
    np.testing.assert_array_equal(going_on, wave[15:23])


def test_the_nearest_stretch_is_held_where_its_clip_ends():
    wave = np.sin(np.arange(14.0) / 3.0)[:, None]
    going_on = baselines.nearest(wave[:10], 8, {"a": wave})
    np.testing.assert_array_equal(going_on[:4], wave[10:])
    np.testing.assert_array_equal(going_on[4:], np.repeat(wave[-1:], 4, axis=0))


@pytest.mark.thorough
@pytest.mark.real_data
def test_the_paper_s_protocol_on_one_clip(data_root):
    from bayesmotion.studies.multifactor import study

    motion = study.training_motion(data_root)
    assert motion.sizes["frame"] == 395
    clips = split(motion)
    assert set(clips) == set(study.TRAINING)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MotionWarning)
        model = study.MODELS["cdm_style"]
        found_fit = fit(model, motion, method=MAP(initial=1, max_steps=150), seed=0)
    clip = study.read_clips(["07_02"], data_root)["07_02"]
    found = study.score(found_fit, clip, 25, 40)
    assert found.error < 0.5 < min(found.baselines.values())
    assert found.coverage90 > 0.6
    # The defaults, which people left out chose, are better than all baselines as well.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MotionWarning)
        usual = fit(Multifactor(), motion, method=MAP(initial=1, max_steps=150), seed=0)
        found = study.score(usual, clip, 25, 40)
    assert found.error < min(found.baselines.values())
    assert found.coverage90 > 0.6
