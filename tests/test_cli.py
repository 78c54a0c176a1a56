"""The command line on small synthetic walkers: files, numbers, messages, exit codes."""

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pybvh
import pytest

from bayesmotion.files import held
from bayesmotion.fit import load
from bayesmotion.motion import (
    make_motion,
    positions,
    read,
    save,
    skeleton_of,
    split,
    write_amc,
    write_asf,
    write_bvh,
)
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.tasks.synthesise import synthesize

pytestmark = pytest.mark.slow

RATE = 30.0
PEOPLE = (["ann", "ben"], ["walk", "run"])
LABELS = "clip,subject,gait\nann-walk,ann,walk\nann-run,ann,run\nben-walk,ben,walk\n"
TRAINING = ("ann-walk", "ann-run", "ben-walk")
# One length of all forecasts: those of another one are compiled anew.
GIVEN = ("--context", 10, "--horizon", 15)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two people's clips at 60 frames a second, as BVH, and one as ASF and AMC, in metres."""
    folder = tmp_path_factory.mktemp("recordings")
    walkers = synthetic_walkers(*PEOPLE, seconds=1.2, frame_rate=60.0, seed=1)
    for clip, motion in split(walkers).items():
        save(motion, folder / f"{clip}.nc")
        write_bvh(motion, folder / f"{clip}.bvh")
    (folder / "labels.csv").write_text(LABELS)
    return folder


@pytest.fixture(scope="module")
def fitted(folder: Path, run) -> Path:
    result = run(*fit_command(folder, folder / "fit.nc", "--json", folder / "fit.json"))
    assert result.exit_code == 0, result.output
    assert "not converged after 40 steps" in result.stdout
    assert f"saved to {folder / 'fit.nc'}" in result.stdout
    assert "warning: the fit stopped after 40 steps" in result.stderr
    assert "--resume goes on from there" in result.stderr
    return folder / "fit.nc"


def fit_command(folder: Path, out: Path, *more: object) -> list[object]:
    files = [folder / f"{clip}.nc" for clip in TRAINING]
    short = ["--initial", 1, "--max-steps", 40]
    labels = ["--labels", folder / "labels.csv"]
    return ["fit", "multifactor", *files, *labels, "--out", out, *short, *more]


def test_help_names_every_command_and_imports_no_model(run):
    result = run("--help")
    assert result.exit_code == 0
    for command in ("demo", "check", "fit", "diagnose", "compare", "calibrate", "forecast"):
        assert command in result.stdout


def test_forecast_tells_the_error_and_writes_all_files(
    folder: Path, fitted: Path, tmp_path: Path, run
):
    names = ("f.json", "f.bvh", "f.png")
    data, bvh, plot = (tmp_path / name for name in names)
    result = run(
        "forecast", fitted, folder / "ben-run.nc", *GIVEN,
        "--json", data, "--bvh", bvh, "--plot", plot,
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    content = json.loads(data.read_text())
    assert set(content["baselines"]) == {"hold", "constant_velocity", "nearest"}
    assert content["clip"] == "ben-run"
    assert (content["context"], content["horizon"], content["draws"]) == (10, 15, 1)
    assert len(content["per_frame"]) == 15
    assert content["error"] == pytest.approx(np.mean(content["per_frame"]))
    assert 0 < content["error"] < min(content["baselines"].values())
    assert list(content["coverage"]) == ["50", "80", "90", "95"]
    assert np.all(np.diff(list(content["coverage"].values())) >= 0)
    assert content["crps"] > 0
    assert np.isfinite(content["log_score"])
    assert f"{content['error']:.3f}" in result.stdout
    assert "the 90% one" in result.stdout
    assert "a point estimate: intervals leave out" in result.stderr
    assert read(bvh).sizes["frame"] == 25
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_several_clips_in_one_go_a_row_each(folder: Path, fitted: Path, tmp_path: Path, run):
    data, scores, out, bvh = (tmp_path / name for name in ("f.json", "s.csv", "f.csv", "f.bvh"))
    save(read(folder / "ben-run.nc").isel(frame=slice(8)), tmp_path / "short.nc")
    files = [folder / "ben-run.nc", folder / "ann-walk.nc", tmp_path / "short.nc"]
    result = run(
        "forecast", fitted, *files, *GIVEN, "--json", data,
        "--scores", scores, "--out", out, "--bvh", bvh, "--draws", 2,
    )  # fmt: skip
    assert result.exit_code == 2
    assert "1 of 3 clips could not be forecast" in result.stderr
    assert "this clip trained the fit: 'ann-walk'" in result.stderr
    rows = json.loads(data.read_text())["clips"]
    # The third holds a clip called as the first: both are called by their folders.
    names = [f"{folder.name}/ben-run", "ann-walk", f"{tmp_path.name}/ben-run"]
    assert [row["clip"] for row in rows] == names
    assert rows[0]["error"] > 0.0
    assert rows[2]["error"] is None
    assert "frames of context" in rows[2]["why"]
    table = pd.read_csv(scores)
    assert table["error"][0] == pytest.approx(rows[0]["error"])
    assert set(pd.read_csv(out)["clip"]) == set(names[:2])
    written = sorted(path.name for path in tmp_path.glob("f-*.bvh"))
    stem = f"f-{folder.name}-ben-run"
    assert written == sorted(
        f"{one}{end}.bvh" for one in (stem, "f-ann-walk") for end in ("", "-draw-1", "-draw-2")
    )


def test_a_search_that_has_not_converged_goes_on(folder: Path, fitted: Path, tmp_path: Path, run):
    out, told = tmp_path / "fit.nc", tmp_path / "fit.json"
    for name in ("fit.nc", "fit.nc.part", "fit.json"):
        shutil.copy(fitted.parent / name, tmp_path / name)
    command = fit_command(folder, out, "--json", told)
    first = json.loads(told.read_text())
    assert (first["converged"], first["steps"]) == (False, 40)
    result = run(*command, "--resume")
    assert result.exit_code == 0, result.output
    second = json.loads(told.read_text())
    assert second["steps"] == 80
    assert second["log_density"] > first["log_density"]
    assert "another model, other settings" in run(*command, "--resume", "--seed", 1).stderr


def test_the_error_is_that_of_the_frames_in_the_file(
    folder: Path, fitted: Path, tmp_path: Path, run
):
    # Holding the last pose needs no model, so its error can be worked out by hand.
    from bayesmotion.motion.features import encode, heading_of, layout_of

    motion = read(folder / "ben-run.nc")
    layout = layout_of(skeleton_of(motion))
    # Which way the clip goes is told by the context frames.
    heading = heading_of(motion.isel(frame=slice(19)))
    angles = encode(motion, layout, heading)[::2, : layout.n_angles]
    by_hand = np.linalg.norm(angles[10:25] - angles[9], axis=1).mean()
    data = tmp_path / "f.json"
    options = [*GIVEN, "--json", data, "--filter", "none"]
    assert run("forecast", fitted, folder / "ben-run.nc", *options).exit_code == 0
    assert json.loads(data.read_text())["baselines"]["hold"] == pytest.approx(by_hand)


def test_a_clip_that_ends_too_soon_has_no_error(folder: Path, fitted: Path, tmp_path: Path, run):
    data, short = tmp_path / "f.json", tmp_path / "short.nc"
    save(read(folder / "ben-run.nc").isel(frame=slice(40)), short)
    options = [*GIVEN, "--json", data]
    result = run("forecast", fitted, short, *options, "--gait", "run")
    assert result.exit_code == 0, result.output
    content = json.loads(data.read_text())
    assert content["error"] is None
    assert content["baselines"] is None
    assert "25 are needed" in result.stdout


def test_a_forecast_looks_at_no_frame_after_the_given_ones(
    folder: Path, fitted: Path, tmp_path: Path, run
):
    whole = read(folder / "ben-run.nc")
    save(whole.isel(frame=slice(19)), tmp_path / "ben-run.nc")
    short = [*GIVEN, "--filter", "lowpass"]
    for path, name in ((folder / "ben-run.nc", "a.bvh"), (tmp_path / "ben-run.nc", "b.bvh")):
        assert run("forecast", fitted, path, *short, "--bvh", tmp_path / name).exit_code == 0
    one, other = read(tmp_path / "a.bvh"), read(tmp_path / "b.bvh")
    np.testing.assert_allclose(one["angle"].values, other["angle"].values, atol=1e-9)


def test_the_missing_cell_opens_in_another_reader(fitted: Path, tmp_path: Path, run):
    bvh = tmp_path / "cell.bvh"
    words = ["--subject", "ben", "--label", "gait=run", "--seconds", 1, "--bvh", bvh]
    result = run("synthesize", fitted, *words, "--plot", tmp_path / "cell.png")
    assert result.exit_code == 0, result.output
    other = pybvh.read_bvh_file(str(bvh))
    theirs = other.joint_positions()
    ours = positions(synthesize(load(fitted), {"subject": "ben", "gait": "run"}, 1.0).motion)
    assert len(theirs) == round(RATE)
    np.testing.assert_allclose(ours.sel(joint=other.joint_names).values, theirs, atol=1e-3)
    assert (tmp_path / "cell.png").stat().st_size > 0


def test_transitions_and_samples(fitted: Path, tmp_path: Path, run, refused):
    bvh = tmp_path / "s.bvh"
    way = ["--subject", "ann", "--transition", "gait=walk,run", "--seconds", 1]
    assert run("synthesize", fitted, *way, "--bvh", bvh).exit_code == 0
    assert read(bvh).sizes["frame"] == 30
    result = run("synthesize", fitted, "--sample", 2, "--seconds", 1, "--bvh", bvh)
    if result.exit_code == 0:
        assert (tmp_path / "s-2.bvh").is_file()
    else:  # styles far from the learned ones may have no forward step
        assert "nearer to the learned" in refused(result)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--subject", "ben"], "--label gait: it is missing. Give one of walk, run."),
        (["--subject", "zoe", "--gait", "run"], "subject 'zoe' is not in the training clips"),
        (["--label", "mood=sad"], "--label mood: the fit has no such factor"),
        (["--label", "gait"], "--label 'gait': it is not factor=level"),
        (["--subject", "ben", "--transition", "gait=run"], "'gait=run' is no way"),
    ],
)
def test_synthesize_refuses(
    fitted: Path, tmp_path: Path, arguments: list[str], told: str, run, refused
):
    result = run("synthesize", fitted, *arguments, "--bvh", tmp_path / "x.bvh")
    assert told in refused(result)
    assert not (tmp_path / "x.bvh").exists()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (["fit", "nonsense", "a.bvh", "--out", "f.nc"], "'nonsense': there is no such model"),
        (["fit", "multifactor", "a.bvh", "--out", "f.nc"], "a.bvh: "),
        (["fit", "multifactor", "a.xyz", "--out", "f.nc"], "'.xyz' are not known"),
        (["fit", "multifactor", "a.bvh", "--out", "f.nc", "--content", "x"], "Use circle, gpdyn"),
        (["fit", "multifactor", "a.bvh", "--out", "f.nc", "--method", "x"], "no such method"),
        (["forecast", "f.nc", "a.bvh"], "f.nc: there is no such file"),
        (["reproduce", "nonsense", "--out", "o"], "'nonsense': there is no such study"),
    ],
)
def test_wrong_words_are_told_in_one_sentence(tmp_path, monkeypatch, change, told, run, refused):
    monkeypatch.chdir(tmp_path)
    assert told in refused(run(*change))
    assert not list(tmp_path.iterdir())


def test_recordings_come_to_any_rate(tmp_path: Path, run):
    # As many frames at this rate as those of the fit have at theirs.
    longer = synthetic_walkers(*PEOPLE, seconds=1.44, frame_rate=60.0, seed=1)
    for clip, motion in split(longer).items():
        save(motion, tmp_path / f"{clip}.nc")
    (tmp_path / "labels.csv").write_text(LABELS)
    result = run(*fit_command(tmp_path, tmp_path / "f.nc", "--rate", 25, "--max-steps", 1))
    assert "recordings of 60 frames a second are resampled to 25" in result.stderr
    assert load(tmp_path / "f.nc").motion.attrs["frame_rate"] == 25.0


def test_a_failed_fit_leaves_the_old_file(folder: Path, tmp_path: Path, monkeypatch, run, refused):
    out = tmp_path / "fit.nc"
    old = b"\x89HDF\r\n\x1a\n the old one, which has a data_hash"
    out.write_bytes(old)
    assert "a.bvh" in refused(run("fit", "multifactor", tmp_path / "a.bvh", "--out", out))

    def die(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("xarray.DataTree.to_netcdf", die)
    result = run(*fit_command(folder, out, "--max-steps", 1))
    assert result.exit_code == 130
    assert "bayesmotion: interrupted" in result.stderr
    assert out.read_bytes() == old
    # Beside it is only the state of the search, to go on from.
    assert {path.name for path in tmp_path.iterdir()} == {"fit.nc", "fit.nc.part"}


def test_an_empty_cell_is_unknown_even_where_the_file_knows(folder: Path, tmp_path: Path, run):
    labels = tmp_path / "labels.csv"
    labels.write_text(LABELS.replace("ben-walk,ben,walk", "ben-walk,,walk"))
    out = tmp_path / "fit.nc"
    result = run(*fit_command(folder, out, "--labels", labels, "--max-steps", 1))
    assert result.exit_code == 0, result.output
    assert "the subject of ben-walk is unknown" in result.stderr
    assert load(out).training.levels["subject"] == ["ann"]


def test_check_tells_the_frames_to_drop(folder: Path, tmp_path: Path, run):
    sound = folder / "ann-walk.bvh"
    result = run("check", sound)
    assert result.exit_code == 0
    assert f"{sound}: nothing found" in result.stdout
    motion = read(folder / "ann-walk.nc")
    angle = motion["angle"].values.copy()
    angle[0] = 0.0
    broken = make_motion(
        skeleton_of(motion), angle, motion["root_position"].values, frame_rate=60.0, clip="ann-walk"
    )
    write_asf(skeleton_of(motion), tmp_path / "ann.asf")
    write_amc(broken, tmp_path / "ann_01.amc")
    told = tmp_path / "check.json"
    result = run("check", tmp_path / "ann_01.amc", sound, "--json", told)
    assert result.exit_code == 1
    content = json.loads(told.read_text())
    assert [bool(one["findings"]) for one in content["files"]] == [True, False]
    assert content["files"][0]["findings"][0]["drop"][0] == 0
    assert "rest pose" in result.stdout
    assert "Drop frame" in result.stdout
    assert f"{sound}: nothing found" in result.stdout


def test_check_goes_on_after_a_refused_file_and_ends_with_a_table(
    folder: Path, tmp_path: Path, run
):
    sound, broken = folder / "ann-walk.bvh", tmp_path / "broken.bvh"
    broken.write_text(sound.read_text().replace("Frame Time: 0.0", "Frame Time: 30.0"))
    told = tmp_path / "check.json"
    result = run("check", broken, sound, "--json", told)
    assert result.exit_code == 2
    refused, looked_over = json.loads(told.read_text())["files"]
    assert "broken.bvh:" in refused["refused"]
    assert looked_over == {"file": str(sound), "findings": []}
    assert "broken.bvh:" in result.stderr
    assert "--frame-rate 30" in result.stderr
    assert f"{sound}: nothing found" in result.stdout
    title, head, *rows = result.stdout.splitlines()[-5:-1]
    assert title == "2 files"
    assert head.split()[:3] == ["file", "clips", "frames"]
    assert [row.split()[-1] for row in rows] == ["refused", "found"]
    result = run("check", broken, "--frame-rate", 60)
    assert (result.exit_code, result.stdout) == (0, f"{broken}: nothing found\n")


def test_the_rate_and_the_skeleton_of_recordings_can_be_said(fitted: Path, tmp_path: Path, run):
    folder = tmp_path / "apart"
    motion = read(fitted.parent / "ann-walk.nc")
    write_asf(skeleton_of(motion), folder / "body.asf")
    write_amc(motion, tmp_path / "ann-walk.amc")
    forecast = ["forecast", fitted, tmp_path / "ann-walk.amc", *GIVEN]
    result = run(*forecast)
    assert result.exit_code == 2
    assert "--skeleton 02.asf" in result.stderr
    # Without the rate these are 120 frames a second, not 60.
    result = run(*forecast, "--skeleton", folder / "body.asf", "--frame-rate", 60)
    assert result.exit_code == 0, result.output
    assert "mean error over 15 frames" in result.stdout


@pytest.mark.slow
def test_the_demo_makes_the_missing_clip(tmp_path: Path, run):
    result = run("demo", "--out", tmp_path / "demo")
    assert result.exit_code == 0, result.output
    content = json.loads((tmp_path / "demo/demo.json").read_text())
    others = [value for name, value in content["distances"].items() if name != "synthesised"]
    assert len(others) == 8
    assert content["closest"] is True
    assert content["distances"]["synthesised"] < 0.5 * min(others)
    assert content["errors"]["forecast"] < 0.5 * content["errors"]["hold the last pose"]
    assert "the synthesised clip is closer than every recorded one" in result.stdout
    written = {path.name for path in (tmp_path / "demo").iterdir()}
    assert written == {
        "fit.nc", "cell.bvh", "forecast.bvh", "grid.png", "forecast.png", "demo.json",
    }  # fmt: skip


@pytest.mark.real_data
def test_fit_and_forecast_of_recordings(data_root: Path, tmp_path: Path, run):
    person = data_root / "cmu/02"
    (tmp_path / "labels.csv").write_text("clip,subject,gait\n02_02,02,walk\n02_03,02,run\n")
    files = [person / "02_02.amc", person / "02_03.amc"]
    words = ["--labels", tmp_path / "labels.csv", "--initial", 1, "--max-steps", 60, "--drop"]
    result = run("fit", "multifactor", *files, "--out", tmp_path / "fit.nc", *words)
    assert result.exit_code == 0, result.output
    assert "warning: 02_03: rest pose" in result.stderr
    data = tmp_path / "f.json"
    given = ["--context", 25, "--horizon", 40]
    result = run("forecast", tmp_path / "fit.nc", person / "02_01.amc", "--json", data, *given)
    assert result.exit_code == 0, result.output
    content = json.loads(data.read_text())
    assert content["error"] < min(content["baselines"].values())


def test_draws_from_the_posterior_and_a_run_that_goes_on(
    folder: Path, tmp_path: Path, monkeypatch, run, refused
):
    out = tmp_path / "fit.nc"
    words = ["--method", "nuts", "--warmup", 20, "--draws", 20, "--chains", 1]
    files = [folder / "ann-walk.nc", folder / "ben-walk.nc"]
    command = ["fit", "multifactor", *files, "--out", out, "--factors", "subject", *words]
    command += ["--max-tree-depth", 3, "--rate", 15]
    from bayesmotion.inference.checkpoint import Checkpoint
    from bayesmotion.inference.sampling import whitening as sampling

    # Where the chains begin is not the point here.
    monkeypatch.setattr(sampling, "MODE_STEPS", 20)
    monkeypatch.setattr(sampling, "ROUNDS", 0)
    whole = Checkpoint.save

    def die_after_one(self, arrays):
        whole(self, arrays)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Checkpoint, "save", die_after_one)
        result = run(*command)
    assert result.exit_code == 130
    assert (
        "fit.nc.part has the mode and the draws so far; --resume goes on from there"
        in result.stderr
    )
    assert not out.exists()
    assert "Go on with --resume" in refused(run(*command))
    result = run(*command, "--resume")
    assert result.exit_code == 0, result.output
    assert "20 draws in" in result.stdout
    assert list(tmp_path.iterdir()) == [out]
    fit = load(out)
    assert fit.tree["posterior"].sizes["draw"] == 20
    assert json.loads(fit.tree.attrs["settings"])["max_tree_depth"] == 3
    # The scales were integrated out, and drawn again.
    scale = fit.tree["posterior"]["scale"]
    assert scale.dims == ("chain", "draw", "feature")
    assert float(scale.min()) > 0.0
    assert float(scale.std("draw").min()) > 0.0
    assert np.all(np.isfinite(fit.tree["log_likelihood"]["y"]))
    trained = fit.model.condition(*fit.training.data, fit.values())
    assert trained.conditioned.half.shape[-1] == scale.sizes["feature"]


def test_what_is_written_is_checked_before_any_work(folder: Path, tmp_path: Path, run, refused):
    """An option that was forgotten before a file must not make it the output."""
    recording, take, notes = folder / "ann-walk.nc", tmp_path / "take.amc", tmp_path / "notes.nc"
    shutil.copy(recording, take)
    notes.write_text("mine")
    before = {path: path.read_bytes() for path in (recording, take, notes)}
    for words, told in (
        (["fit", "multifactor", recording, "--out", recording], "read by the same command"),
        (["fit", "multifactor", recording, "--out", take], "a fit is written as .nc"),
        (["fit", "multifactor", recording, "--out", notes], "a file that holds no fit"),
        (["fit", "multifactor", tmp_path / "none.nc", "--out", recording], "holds no fit"),
        (["voxels", folder / "ann-walk.bvh", "--out", folder / "ann-walk.bvh"], "as .nc"),
        (["forecast", "f.nc", recording, "--bvh", "a.bvh", "--plot", "a.bvh"], "a picture is"),
        (["forecast", "f.nc", recording, "--json", notes], "written as .json"),
        (["forecast", "f.nc", recording, "--out", recording], "read by the same command"),
        (["forecast", "f.nc", recording, "--out", notes], "a file that holds no table of means"),
        (["forecast", notes, recording, "--draws", 2], "Say --bvh F as well"),
        (["synthesize", notes, "--bvh", notes / "a.bvh"], "is no folder"),
        (["speak", "f.nc", "in.mp4", "--out", "in.mp4", "--portrait", "a.npz"], "read by the same"),
        (["demo", "--out", notes], "it is no folder"),
    ):
        assert told in refused(run(*words)), words
    assert {path: path.read_bytes() for path in before} == before


def test_one_process_at_a_time_writes_a_fit(folder: Path, tmp_path: Path, run, refused):
    out = tmp_path / "fit.nc"
    with held([out]):
        assert "another process is at work on it" in refused(run(*fit_command(folder, out)))
    assert not list(tmp_path.iterdir())


def test_what_nobody_thought_of_is_told_as_a_fault_of_ours(tmp_path: Path, monkeypatch, run):
    def fail(*_, **__):
        return {}["a surprise"]

    monkeypatch.setattr("bayesmotion.motion.io.reading.read", fail)
    result = run("check", tmp_path / "a.nc")
    assert result.exit_code == 70
    assert "Traceback" in result.stderr
    last = result.stderr.splitlines()[-1]
    assert last.startswith("bayesmotion: KeyError: this is a fault of bayesmotion")
    assert "report it" in last


@pytest.mark.parametrize("seed", [-1, 2**32])
def test_seeds_that_are_none_are_refused(folder: Path, tmp_path: Path, seed, run):
    result = run(*fit_command(folder, tmp_path / "fit.nc", "--seed", seed))
    assert result.exit_code == 2
    assert "--seed" in result.stderr


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--chains", 2], "--chains: it says nothing to the method map. It has --initial"),
        (["--method", "nuts", "--walkers", 20], "--walkers: it says nothing to the method nuts"),
        (["--method", "nuts", "--mass", "heavy"], "--mass heavy: there is no such"),
    ],
)
def test_options_of_another_method_are_refused(tmp_path, words, told, run, refused):
    assert told in refused(run("fit", "multifactor", "a.bvh", "--out", tmp_path / "f.nc", *words))
