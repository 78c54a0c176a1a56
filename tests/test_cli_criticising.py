"""The commands diagnose, loo and compare on fits of a model that no command knows by name."""

import json

import numpy as np
import pytest
import xarray as xr

import bayesmotion as bm


@pytest.fixture(scope="module")
def files(mean_cycle, tmp_path_factory):
    """Fits of the same two clips: one of the right period, one of a wrong period held to it."""
    folder = tmp_path_factory.mktemp("fits")
    _, recordings = mean_cycle.example()
    recordings = recordings.assign_coords(clip=("frame", np.repeat(["one", "two"], 30)))
    short = bm.MAP(initial=1, keep=1, max_steps=300)
    paths = {}
    for name, period in (("right", 20.0), ("wrong", 5.0)):
        model = mean_cycle(period_frames=period)
        bm.fit(model, recordings, method=short, seed=0).save(folder / f"{name}.nc")
        paths[name] = folder / f"{name}.nc"
    other = recordings.copy(deep=True)
    other["y"][0, 0] += 1e-6
    bm.fit(mean_cycle(), other, method=short, seed=0).save(folder / "other.nc")
    return {**paths, "other": folder / "other.nc"}


def test_diagnose_says_of_a_point_that_it_is_one(files, tmp_path, run, refused):
    result = run("diagnose", files["right"])
    assert result.exit_code == 0, result.output
    assert "no R-hat" in result.stdout
    assert "Nothing speaks against this fit." in result.stdout
    line = refused(run("diagnose", files["right"], "--plot", tmp_path / "chains.png"))
    assert "no chains to draw" in line


@pytest.mark.filterwarnings("ignore:the fit stopped")
def test_diagnose_fails_where_the_search_has_not_converged(mean_cycle, tmp_path, run):
    model, recordings = mean_cycle.example()
    stopped = bm.fit(model, recordings, method=bm.MAP(initial=1, keep=1, max_steps=1), seed=0)
    stopped.save(tmp_path / "stopped.nc")
    result = run("diagnose", tmp_path / "stopped.nc", "--json", tmp_path / "d.json")
    assert result.exit_code == 1
    assert "has not converged" in result.stdout
    assert json.loads((tmp_path / "d.json").read_text())["trusted"] is False


def test_diagnose_draws_chains(cycle_draws, tmp_path, run):
    cycle_draws.save(tmp_path / "fit.nc")
    result = run("diagnose", tmp_path / "fit.nc", "--plot", tmp_path / "chains.png")
    assert "bulk ESS" in result.stdout
    assert (tmp_path / "chains.png").read_bytes().startswith(b"\x89PNG")


def test_loo_is_that_of_arviz_on_the_tree(cycle_draws, tmp_path, run):
    import arviz_stats as azs

    cycle_draws.save(tmp_path / "fit.nc")
    result = run("loo", tmp_path / "fit.nc", "--json", tmp_path / "loo.json")
    assert result.exit_code == 0, result.output
    content = json.loads((tmp_path / "loo.json").read_text())
    expected = azs.loo(cycle_draws.tree, pointwise=True)
    # How efficient draws are ArviZ takes from all sites, the command from those of one number.
    assert content["elpd"] == pytest.approx(expected.elpd, rel=1e-3)
    assert expected.n_data_points == 59
    # Frame 41 was not seen at all, and is no point.
    assert content["points"]["frame"] == [i for i in range(60) if i != 41]
    assert sum(content["points"]["elpd"]) == pytest.approx(content["elpd"], rel=1e-12)
    assert f"{content['elpd']:.2f}" in result.stdout


def test_loo_by_a_label_fits_again(files, tmp_path, run, refused):
    result = run("loo", files["right"], "--by", "clip", "--json", tmp_path / "loo.json")
    assert result.exit_code == 0, result.output
    content = json.loads((tmp_path / "loo.json").read_text())
    assert content["points"]["clip"] == ["one", "two"]
    assert "2 clips left out" in result.stdout
    assert "no such label" in refused(run("loo", files["right"], "--by", "week"))
    assert "says nothing" in refused(run("loo", files["right"], "--by", "clip", "--most", 5))


def test_compare_prefers_the_right_model_and_refuses_other_data(files, tmp_path, run, refused):
    for by in ("point", "clip"):
        words = ("compare", files["right"], files["wrong"], "--by", by)
        result = run(*words, "--json", tmp_path / "table.json")
        assert result.exit_code == 0, result.output
        content = json.loads((tmp_path / "table.json").read_text())
        assert content["by"] == by
        assert content["models"][0]["fit"] == "right", by
        worst = min(row["elpd_diff"] for row in content["models"])
        assert worst < -4.0
        assert f"{worst:.3f}" in result.stdout
    assert "at least two" in refused(run("compare", files["right"]))
    assert "different data" in refused(run("compare", files["right"], files["other"]))


def test_the_tree_of_a_fit_has_points_and_their_joint_density(cycle_draws):
    tree = cycle_draws.tree
    assert tree["log_likelihood"]["y"].dims == ("chain", "draw", "point")
    # Frames are independent here given all sites: they add up to the joint density.
    np.testing.assert_allclose(
        tree["log_likelihood"]["y"].sum("point"), tree["joint_log_likelihood"]["y"], rtol=1e-10
    )
    left = bm.leave_one_out(cycle_draws)["log_likelihood"].to_dataset()
    xr.testing.assert_allclose(
        left["y"].drop_vars(("chain", "draw"), errors="ignore"),
        tree["log_likelihood"].to_dataset()["y"].drop_vars(("chain", "draw"), errors="ignore"),
    )
