"""What the pages say is what the results' files hold."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bayesmotion.benchmarks import bench
from bayesmotion.benchmarks import report as bench_report
from bayesmotion.gp.series import SETTINGS
from bayesmotion.studies import leaderboard
from bayesmotion.studies.calibration import report as calibration_report
from bayesmotion.studies.calibration import study as calibration
from bayesmotion.studies.cmu35 import report as cmu35_report
from bayesmotion.studies.cmu35 import study as cmu35
from bayesmotion.studies.cmu_mm import report as cmu_mm_report
from bayesmotion.studies.cmu_mm import study as cmu_mm
from bayesmotion.studies.denoising import report as denoising_report
from bayesmotion.studies.denoising import study as denoising
from bayesmotion.studies.gait_pose import report as gait_pose_report
from bayesmotion.studies.gait_pose import study as gait_pose
from bayesmotion.studies.gait_questions import report as gait_questions_report
from bayesmotion.studies.gait_questions import study as gait_questions
from bayesmotion.studies.gaps import report as gaps_report
from bayesmotion.studies.gaps import study as gaps
from bayesmotion.studies.gpode import report as gpode_report
from bayesmotion.studies.gpode import study as gpode
from bayesmotion.studies.keypose import report as keypose_report
from bayesmotion.studies.keypose import study as keypose
from bayesmotion.studies.multifactor import report as multifactor_report
from bayesmotion.studies.multifactor import study as multifactor
from bayesmotion.studies.multifactor.left_out import choose, lengths_of
from bayesmotion.studies.pace import report as pace_report
from bayesmotion.studies.pace import study as pace
from bayesmotion.studies.posterior import report as posterior_report
from bayesmotion.studies.posterior import study as posterior
from bayesmotion.studies.speech import report as speech_report
from bayesmotion.studies.speech import study as speech
from bayesmotion.studies.tables import page_block
from bayesmotion.studies.voxel import report as voxel_report
from bayesmotion.studies.voxel import study as voxel

ROOT = Path(__file__).parent.parent


def test_the_readme_shows_the_landed_results():
    results = json.loads((ROOT / "docs/results/multifactor.json").read_text(encoding="utf-8"))
    shown = page_block(multifactor_report.markdown, results)
    assert shown in (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "module"),
    [
        ("calibration", calibration_report),
        ("cmu35", cmu35_report),
        ("cmu-mm", cmu_mm_report),
        ("denoising", denoising_report),
        ("gait-pose", gait_pose_report),
        ("gait-questions", gait_questions_report),
        ("gpode", gpode_report),
        ("gaps", gaps_report),
        ("keypose", keypose_report),
        ("pace", pace_report),
        ("posterior", posterior_report),
        ("speech", speech_report),
        ("voxel", voxel_report),
    ],
)
def test_a_page_shows_the_landed_results(name, module):
    results = json.loads((ROOT / f"docs/results/{name}.json").read_text(encoding="utf-8"))
    shown = page_block(module.markdown, results)
    page = "boards" if name in ("cmu35", "cmu-mm", "gpode", "pace") else name
    assert shown in (ROOT / f"docs/{page}.md").read_text(encoding="utf-8")
    assert shown.count("|") > 20


@pytest.mark.parametrize(
    ("name", "study"),
    [
        ("calibration", calibration),
        ("cmu35", cmu35),
        ("cmu-mm", cmu_mm),
        ("denoising", denoising),
        ("gait-pose", gait_pose),
        ("gait-questions", gait_questions),
        ("gpode", gpode),
        ("gaps", gaps),
        ("keypose", keypose),
        ("multifactor", multifactor),
        ("pace", pace),
        ("posterior", posterior),
        ("speech", speech),
        ("voxel", voxel),
    ],
)
def test_results_are_of_the_settings_of_the_code(name, study):
    results = json.loads((ROOT / f"docs/results/{name}.json").read_text(encoding="utf-8"))
    if "made_with" in results:
        assert results["settings"] == json.loads(json.dumps(study.plan(0)))
    else:
        # The page says so (`page_block`).
        assert results.get("settings") != json.loads(json.dumps(study.plan(0)))


@pytest.mark.parametrize("task", leaderboard.TASKS)
def test_the_leaderboard_shows_the_landed_results(task):
    shown = leaderboard.block(task, ROOT / "docs/results")
    assert shown in (ROOT / "docs/leaderboard.md").read_text(encoding="utf-8")
    assert shown.count("|") > 15


def test_the_page_on_performance_shows_what_was_measured():
    results = json.loads((ROOT / "docs/results/bench.json").read_text(encoding="utf-8"))
    shown = page_block(bench_report.markdown, results)
    assert shown in (ROOT / "docs/performance.md").read_text(encoding="utf-8")
    assert shown.count("|") > 20
    assert results["settings"] == json.loads(json.dumps(bench.plan()))


def test_the_noise_of_the_circle_model_is_what_the_training_clips_chose():
    results = json.loads((ROOT / "docs/results/multifactor.json").read_text(encoding="utf-8"))
    assert choose(results["left_out"]) == "cdm_style"


def test_the_settings_of_smoothing_are_what_the_training_trials_chose():
    results = json.loads((ROOT / "docs/results/denoising.json").read_text(encoding="utf-8"))
    assert denoising.settings_of(denoising.best_variant(results)) == SETTINGS


def test_what_a_page_tells_does_not_outlive_what_the_study_gave():
    results = json.loads((ROOT / "docs/results/keypose.json").read_text(encoding="utf-8"))
    shown = keypose_report.markdown(results)
    assert f"{results['known']['person']['tensor_bayes']:.3f}" in shown
    assert keypose_report.markdown({}) == ""


def test_a_study_that_was_interrupted_shows_the_stages_it_came_to():
    sampled = {
        "max_r_hat": 1.004,
        "naive_max_r_hat": 1.75,
        "turned_max_r_hat": 9.3,
        "clips": ["a", "b"],
        "min_ess_bulk": 812.0,
        "divergences": 0,
        "seconds": 95.0,
    }
    kinds = {"map": 0.5, "posterior": 0.25}
    figures = ("mean_error", "crps", "log_score", "coverage90")
    result = {"cdm_style": sampled, "forecast": dict.fromkeys(figures, kinds)}
    text = posterior_report.markdown(result)
    assert "| stylistic circle | a, b | 1.004 | 1.750 | 9.3 | 812 | 0 | 95 |" in text
    assert "| posterior | 0.250 | 0.2500 | 0.25 | 25 % |" in text
    assert "stacked" not in text
    begun = posterior_report.markdown({"cdm_style": sampled, "forecast": {"per_clip": {}}})
    assert "CRPS" not in begun


def test_a_clip_is_forecast_as_far_as_it_goes():
    def of(frames: int) -> xr.Dataset:
        return xr.Dataset(coords={"frame": np.arange(frames)})

    assert [lengths_of(of(frames)) for frames in (90, 65, 64, 33)] == [(25, 40)] * 2 + [
        (13, 20)
    ] * 2
