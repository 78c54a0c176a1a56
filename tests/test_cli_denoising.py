"""The command that takes noise out of a recording."""

import json

import numpy as np
import pandas as pd
import pytest

from bayesmotion.motion import read, save, split
from bayesmotion.motion.synthetic.walkers import synthetic_walkers


@pytest.fixture(scope="module")
def noisy(tmp_path_factory):
    walkers = synthetic_walkers(("ann",), ("walk",), seconds=1.0, frame_rate=60.0)
    walk = split(walkers)["ann-walk"]
    white = np.random.default_rng(0).normal(size=walk["angle"].shape)
    path = tmp_path_factory.mktemp("noisy") / "walk.nc"
    save(walk.assign(angle=walk["angle"] + np.deg2rad(2.0) * white), path)
    return path


def test_a_recording_is_written_back_with_its_uncertainty(noisy, tmp_path, run):
    out, table, data = tmp_path / "clean.bvh", tmp_path / "clean.csv", tmp_path / "clean.json"
    result = run("denoise", noisy, "--out", out, "--table", table, "--json", data,
                 "--plot", tmp_path / "clean.png")  # fmt: skip
    assert result.exit_code == 0, result.output
    told = json.loads(data.read_text())
    assert told["estimated"]
    assert abs(told["noise_degrees"] - 2.0) < 0.3
    assert f"noise of {told['noise_degrees']:.3g} degrees (estimated)" in result.stdout
    made = read(out)
    assert made.sizes["frame"] == told["frames"] == 60
    assert made.attrs["frame_rate"] == 60.0
    rows = pd.read_csv(table)
    assert (rows["q95"] >= rows["q05"]).all()
    assert (tmp_path / "clean.png").stat().st_size > 0


def test_the_noise_can_be_given_and_wrong_words_are_refused(noisy, tmp_path, run, refused):
    out = tmp_path / "same.nc"
    result = run("denoise", noisy, "--noise", 0, "--out", out)
    assert result.exit_code == 0, result.output
    assert "noise of 0 degrees (given)" in result.stdout
    np.testing.assert_array_equal(read(out)["angle"].values, read(noisy)["angle"].values)
    assert "is written as" in refused(run("denoise", noisy, "--out", tmp_path / "clean.mp4"))
    assert "read by the same command" in refused(run("denoise", noisy, "--out", noisy))
