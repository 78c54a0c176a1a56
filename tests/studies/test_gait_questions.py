"""The study of gait questions: its designs, and all of it in a small setting."""

import numpy as np
import pytest

from bayesmotion.studies.gait_questions import designs, report, study


def test_designs_are_what_they_say():
    design = designs.DESIGNS["pairs of strides, unbalanced"]
    curves = designs.simulated(design, np.random.default_rng(0))
    person, condition = curves["subject"].values, curves["condition"].values
    for number in range(8):
        for side in "ab":
            kept = (person == f"p{number}") & (condition == side)
            assert kept.sum() == design.strides[number]
    wide = designs.Simulated((400,), 20.0, (1,), 1.5, 0.0, bump=2.0)
    curves = designs.simulated(wide, np.random.default_rng(0)).values
    away = curves[::2] - curves[1::2]
    np.testing.assert_allclose(away.mean(axis=0), designs.difference_of(wide), atol=0.4)
    np.testing.assert_allclose(away.std(axis=0), 1.5 * np.sqrt(2.0), rtol=0.2)
    # Full width at half maximum of the kernel: neighbours correlate as theory says.
    correlation = np.corrcoef(away.T).diagonal(10).mean()
    np.testing.assert_allclose(correlation, np.exp(-2.0 * np.log(2.0) * 0.25), atol=0.05)


def test_the_study_runs_through(tmp_path, monkeypatch):
    pytest.importorskip("spm1d")
    chosen = ("pairs", "groups of strides, unbalanced")
    monkeypatch.setattr(study, "DESIGNS", {name: designs.DESIGNS[name] for name in chosen})
    monkeypatch.setattr(study, "REPETITIONS", 3)
    every = study.data_sets()
    assert len(every) == 21
    few = {name: every[name] for name in list(every)[:1] + list(every)[-2:]}
    monkeypatch.setattr(study, "data_sets", lambda: few)
    result = study.reproduce(None, tmp_path, say=lambda line: None)
    assert result["sets"]["Pataky2008 vertical force, fast less slow strides"]["people"] == [10]
    shown = report.markdown(result)
    assert "Caravaggi2010" in shown
    assert len(result["simulated"]["pairs"]["errs"]) == 3
    assert report.markdown({"settings": result["settings"], "sets": {}}) == ""
