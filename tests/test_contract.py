"""The contract of all models, and of one that a user writes from the page on adding a model."""

import numpy as np
import pytest
import xarray as xr

import bayesmotion as bm
from bayesmotion.registry import model_class, model_names

# Those of the package: tests register further ones of their own.
NAMES = model_names()


# Of these every verb is asked whenever tests are run; all others are fitted, criticised, saved.
ALWAYS = ("multifactor", "relevance_vectors")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=() if n in ALWAYS else pytest.mark.thorough) for n in NAMES],
)
def test_every_model_keeps_the_contract(name):
    assert bm.check_model(model_class(name))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
# Some examples are stopped early by the default number of steps, and say so.
@pytest.mark.filterwarnings("ignore::bayesmotion.errors.MotionWarning")
def test_every_model_is_fitted_as_it_comes(name, tmp_path):
    assert name in bm.models().index
    model, recordings = bm.example(name)
    fit = bm.fit(model, recordings, seed=0)
    assert fit.point_estimate
    assert len(bm.diagnose(fit).sentences) > 0
    assert np.isfinite(bm.leave_one_out(fit)["log_likelihood"]["y"].values).all()
    page = bm.report(fit, draws=4)
    assert page.sections[0].title == "Before you trust it"
    assert any("point estimate" in text for text in page.warnings)
    page.write(tmp_path / "report.html")
    fit.save(tmp_path / "fit.nc")
    back = bm.load(tmp_path / "fit.nc")
    assert back.model == model
    xr.testing.assert_identical(back.tree["posterior"].ds, fit.tree["posterior"].ds)


def test_a_model_from_the_page_keeps_the_contract(mean_cycle):
    assert bm.check_model(mean_cycle)


def test_the_page_runs(mean_cycle, page_blocks):
    names = {"bm": bm, "MeanCycle": mean_cycle}
    for block in page_blocks[1:]:
        exec(block, names)
    assert names["fit"].model == mean_cycle()
