"""The contract of all models, and of one that a user writes from the page on adding a model."""

import numpy as np
import pytest
import xarray as xr

import bayesmotion as bm
from bayesmotion.registry import model_class, model_names

# Those of the package: tests register further ones of their own.
NAMES = model_names()
# Of fewer, a chain may stand still, and there is no leaving out by its draws.
FEW = bm.NUTS(draws=50, warmup=50, chains=2, max_tree_depth=6)
# So few draws are warned of, rightly.
few_draws = pytest.mark.filterwarnings("ignore::bayesmotion.errors.MotionWarning")


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_every_model_keeps_the_contract(name):
    # As many draws as below: what is compiled here serves there.
    assert bm.check_model(model_class(name), draws=50)


def told(fit: bm.Fit, recordings: xr.Dataset) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    sites = bm.predict(fit, recordings).sites
    return {name: (site.means(), site.sds()) for name, site in sites.items()}


def backwards(fit: bm.Fit) -> bm.Fit:
    tree = fit.tree.copy()
    posterior = tree["posterior"].to_dataset().isel(draw=slice(None, None, -1))
    tree["posterior"] = xr.DataTree(posterior)
    return bm.Fit(fit.model, fit.motion, tree)


@few_draws
@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_one_script_serves_every_model(name, tmp_path):
    assert name in bm.models().index
    model, recordings = bm.example(name)
    fits = {"point": bm.fit(model, recordings, seed=0)}
    fits["draws"] = bm.fit(model, recordings, method=FEW, seed=0)
    for kind, fit in fits.items():
        assert len(bm.diagnose(fit).sentences) > 0
        points = bm.leave_one_out(fit)["log_likelihood"]["y"]
        assert np.isfinite(points.values).all()
        before = told(fit, recordings)
        fit.save(tmp_path / f"{kind}.nc")
        after = told(bm.load(tmp_path / f"{kind}.nc"), recordings)
        turned = told(backwards(fit), recordings)
        for site, parts in before.items():
            for one, same, close in zip(parts, after[site], turned[site], strict=True):
                np.testing.assert_array_equal(same, one, err_msg=f"{kind} {site}")
                np.testing.assert_allclose(close, one, rtol=1e-9, atol=1e-9, err_msg=site)
    table = bm.compare(fits).table
    assert set(table.index) == set(fits)
    assert np.isfinite(table["elpd"]).all()


def test_a_model_from_the_page_keeps_the_contract(mean_cycle):
    assert bm.check_model(mean_cycle)


def test_the_page_runs(mean_cycle, page_blocks):
    names = {"bm": bm, "MeanCycle": mean_cycle}
    for block in page_blocks[1:]:
        exec(block, names)
    assert names["fit"].model == mean_cycle()
