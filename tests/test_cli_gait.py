"""Gait-pose models on the command line: fit, reconstruct, filter, and what is refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from bayesmotion.fit import load
from bayesmotion.models.gait_pose import VARIANTS
from bayesmotion.motion import read, save, split
from bayesmotion.motion.gait_skeleton import without_joints
from bayesmotion.motion.synthetic.walkers import synthetic_walkers


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("walks")
    people = ("ann", "ben", "cas", "dee")
    walkers = synthetic_walkers(people, ("walk",), seconds=2.6, frame_rate=60.0, styles=2)
    for clip, motion in split(walkers).items():
        save(motion, folder / f"{clip}.nc")
    return folder


@pytest.fixture(scope="module")
def fitted(folder: Path, run) -> Path:
    files = [folder / f"{person}-walk.nc" for person in ("ann", "ben", "cas")]
    out = folder / "torus.nc"
    result = run("fit", "gait-pose", *files, "--out", out, "--surface", "torus", "--cycles", 1,
                 "--method", "local", "--sweeps", 3)  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "converged after" in result.stdout
    return out


def test_a_fit_is_what_was_asked_for(fitted: Path):
    fit = load(fitted)
    assert fit.model == VARIANTS["torus1"]
    assert fit.tree.attrs["inference"] == "local"
    assert json.loads(fit.tree.attrs["settings"])["sweeps"] == 3
    assert len(fit.training.frames.y) == 90


def test_a_limb_is_filled_in_and_written(folder: Path, fitted: Path, tmp_path: Path, run):
    bvh, data = tmp_path / "made.bvh", tmp_path / "made.json"
    result = run("reconstruct", fitted, folder / "dee-walk.nc", "--missing", "larm,lleg",
                 "--bvh", bvh, "--json", data)  # fmt: skip
    assert result.exit_code == 0, result.output
    content = json.loads(data.read_text())
    assert content["cycle"] == "dee-walk#1"
    assert f"mean error {content['error_mm']:.1f} mm" in result.stdout
    assert 0.0 < content["error_mm"] < 150.0
    assert 0.0 <= content["coverage90"] <= 1.0
    for name, error in content["baselines_mm"].items():
        assert f"{name.replace('_', ' ')} {error:.1f}" in " ".join(result.stdout.split())
    assert set(content["baselines_mm"]) == {"mean_cycle", "pca", "nearest_pose"}
    assert read(bvh).sizes["frame"] == 30
    wrong = run("reconstruct", fitted, folder / "dee-walk.nc", "--missing", "tail")
    assert wrong.exit_code == 2
    assert "does not turn" in wrong.stderr


def test_a_limb_that_is_nan_or_zero_has_no_error(folder: Path, fitted: Path, tmp_path, run):
    walk = read(folder / "dee-walk.nc")
    arm = ("lhumerus", "lradius", "lwrist")
    gone = without_joints(walk, arm)
    for name, motion in (("nan", gone), ("zero", gone.assign(angle=gone["angle"].fillna(0.0)))):
        save(motion, tmp_path / f"{name}.nc")
    data = tmp_path / "made.json"
    for clip, words, why in (
        ("nan", [], "no values for lhumerus, lradius, lwrist"),
        ("nan", ["--missing", "larm"], "no values for lhumerus, lradius, lwrist"),
        ("zero", ["--missing", "larm"], "lhumerus, lradius, lwrist still over the whole cycle"),
    ):
        result = run("reconstruct", fitted, tmp_path / f"{clip}.nc", *words, "--json", data,
                     "--plot", tmp_path / "made.png")  # fmt: skip
        assert result.exit_code == 0, result.output
        assert "mean error" not in result.stdout
        assert "filled in lhumerus, lradius, lwrist" in result.stdout
        content = json.loads(data.read_text())
        assert content["missing"] == list(arm)
        assert (content["error_mm"], content["coverage90"]) == (None, None)
        assert why in content["why"]
        assert why in " ".join(result.stdout.split())
        assert (tmp_path / "made.png").stat().st_size > 0
    # Zeros that nobody said to be missing are warned of.
    silent = run("reconstruct", fitted, tmp_path / "zero.nc")
    assert silent.exit_code == 2
    assert "nothing is missing" in silent.stderr
    assert "larm is at rest" in " ".join(silent.stderr.split())


def test_the_filter_takes_a_recording_without_a_leg(folder: Path, fitted: Path, tmp_path, run):
    walk, data, bvh = tmp_path / "leg.nc", tmp_path / "leg.json", tmp_path / "leg.bvh"
    save(without_joints(read(folder / "dee-walk.nc"), ["rfemur"]), walk)
    result = run("filter", fitted, walk, "--noise", 0.05, "--json", data, "--bvh", bvh)
    assert result.exit_code == 0, result.output
    content = json.loads(data.read_text())
    assert content["missing"] == ["rfemur", "rtibia", "rfoot"]
    assert 0.0 <= content["moved_mm"] < 100.0
    assert np.isfinite(read(bvh)["angle"].values).all()
    both = run("filter", fitted, walk, "--missing", "lleg")
    assert both.exit_code == 2
    assert "both feet are missing" in " ".join(both.stderr.split())


def test_noise_is_taken_out(folder: Path, fitted: Path, tmp_path: Path, run):
    data = tmp_path / "level.json"
    result = run("filter", fitted, folder / "dee-walk.nc", "--noise", 0.05, "--json", data)
    assert result.exit_code == 0, result.output
    assert "noise of 5 % of the motion (given)" in result.stdout
    assert json.loads(data.read_text())["level"] == 0.05
    estimated = run("filter", fitted, folder / "dee-walk.nc")
    assert "(estimated)" in estimated.stdout


def test_unknown_surfaces_and_options_are_refused(folder: Path, tmp_path: Path, run, refused):
    command = ("fit", "gait-pose", folder / "ann-walk.nc", "--out", tmp_path / "a.nc")
    assert "'sphere' is none. Use torus" in refused(run(*command, "--surface", "sphere"))
    assert "'gp' is none. Use pathdynamics" in refused(run(*command, "--dynamics", "gp"))
    assert run(*command, "--variant", "torus1").exit_code == 2
    for method, option in (("local", "--max-steps"), ("map", "--sweeps")):
        silent = run(*command, "--method", method, option, 3)
        assert f"{option}: it says nothing to the method {method}" in refused(silent)
    assert not (tmp_path / "a.nc").exists()


def test_commands_of_other_models_refuse_the_fit(folder: Path, fitted: Path, tmp_path: Path, run):
    for command, told in (
        (
            ["forecast", fitted, folder / "dee-walk.nc"],
            "does not predict the frames of motions. Fit multifactor.",
        ),
        (["synthesize", fitted, "--bvh", tmp_path / "a.bvh"], "it is a fit of gait_pose"),
    ):
        result = run(*command)
        assert result.exit_code == 2, command
        assert told in result.stderr


def test_a_walk_along_the_surface_is_written(fitted: Path, tmp_path: Path, run):
    bvh = tmp_path / "spiral.bvh"
    result = run("synthesize", fitted, "--path", "inner-spiral", "--seconds", 1.5, "--bvh", bvh)
    assert result.exit_code == 0, result.output
    made = read(bvh)
    assert made.sizes["frame"] == 45
    # It walks: the hips swing.
    assert float(made["angle"].sel(dof="lfemur/rx").std()) > 0.1
    bvh.unlink()
    wrong = run("synthesize", fitted, "--path", "zigzag", "--bvh", bvh)
    assert wrong.exit_code == 2
    assert "no such path" in wrong.stderr
    labelled = run("synthesize", fitted, "--path", "line", "--subject", "x", "--bvh", bvh)
    assert labelled.exit_code == 2
    assert not bvh.exists()


def test_a_clip_has_only_so_many_cycles(folder: Path, fitted: Path, run):
    result = run("filter", fitted, folder / "dee-walk.nc", "--cycle", 9)
    assert result.exit_code == 2
    assert "straight cycles" in result.stderr
    assert np.isfinite(load(fitted).stats()["lp"])
