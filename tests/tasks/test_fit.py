"""Fits are kept whole: what was saved predicts to the last bit what it did before."""

import numpy as np
import pytest
import xarray as xr

import bayesmotion
from bayesmotion.errors import InputError, MotionWarning
from bayesmotion.inference.optimisation.map import fit_map
from bayesmotion.models.multifactor import Multifactor
from bayesmotion.motion import split
from bayesmotion.motion.synthetic.walkers import synthetic_truth
from bayesmotion.netcdf import write_netcdf
from bayesmotion.tasks.forecast import forecast


@pytest.fixture(scope="module")
def saved(circle_fit, tmp_path_factory):
    path = tmp_path_factory.mktemp("fit") / "fit.nc"
    circle_fit.save(path)
    return path


def test_a_loaded_fit_predicts_the_same_to_the_last_bit(circle_fit, saved):
    clip = synthetic_truth(gaits=("walk", "run"), frame_rate=20.0).cell("ben", "run")
    back = bayesmotion.load(saved)
    assert back.model == circle_fit.model
    before = forecast(circle_fit, clip, context=16, horizon=20)
    after = forecast(back, clip, context=16, horizon=20)
    np.testing.assert_array_equal(before.mean, after.mean)
    np.testing.assert_array_equal(before.sd, after.sd)


def test_how_new_people_are_seen_is_saved_too(circle_fit, with_novel, tmp_path):
    changed = with_novel(circle_fit, 2)
    changed.save(tmp_path / "changed.nc")
    assert bayesmotion.load(tmp_path / "changed.nc").model == changed.model != circle_fit.model


def test_a_fit_says_what_it_is(circle_fit):
    tree = circle_fit.tree
    assert {"posterior", "sample_stats", "observed_data", "constant_data"} <= set(tree.children)
    assert tree["posterior"]["style_subject"].dims == (
        "chain", "draw", "level_subject", "axis_subject",
    )  # fmt: skip
    assert tree["posterior"]["level_subject"].values.tolist() == ["ann", "ben", "cas"]
    assert {"versions", "seed", "data_hash", "seconds", "warnings"} <= set(tree.attrs)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"schema": 99}, "schema 99"),
        ({"model": '{"name": "other"}'}, "'other'"),
    ],
)
def test_another_schema_or_model_is_refused(saved, tmp_path, change, said):
    tree = xr.open_datatree(saved, engine="h5netcdf").load()
    tree.close()
    tree.attrs |= change
    write_netcdf(tmp_path / "changed.nc", tree)
    with pytest.raises(InputError, match=said):
        bayesmotion.load(tmp_path / "changed.nc")


def test_what_is_no_fit_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        bayesmotion.load(tmp_path / "none.nc")
    (tmp_path / "text.nc").write_text("not a fit")
    with pytest.raises(InputError, match="cannot be read"):
        bayesmotion.load(tmp_path / "text.nc")
    xr.Dataset({"a": 1}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(InputError, match="no fit"):
        bayesmotion.load(tmp_path / "other.nc")


def test_an_unlabelled_clip_has_styles_of_its_own(walkers):
    # The only clip of one person: levels are as many as of `circle_fit`, compiled for that.
    subject = np.where(walkers["clip"] == "ben-walk", "", walkers["subject"])
    unknown = walkers.assign_coords(subject=("frame", subject))
    assert len(split(unknown)) == 5
    with pytest.warns(MotionWarning, match="not converged"):
        fit = fit_map(Multifactor(), unknown, starts=1, max_steps=20)
    assert fit.tree["posterior"]["level_subject"].values.tolist() == [
        "ann", "cas", "unknown 1",
    ]  # fmt: skip
