"""The study of pace goes through, and chooses among views of the model alone."""

import json
from pathlib import Path

import pytest

from bayesmotion.models.multifactor import Circle, Multifactor
from bayesmotion.motion import concat, split
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.studies.pace import report, study
from bayesmotion.studies.tables import page_block


def test_a_view_changes_what_it_names_alone():
    model = study.seen_by(Multifactor(), {"wander_sd": 0.1, "context_weight": 0.5})
    assert model.content == Circle(wander_sd=0.1)
    assert model.context_weight == 0.5
    assert model.student_df == Multifactor().student_df


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::bayesmotion.errors.MotionWarning")
def test_the_study_goes_through(monkeypatch, tmp_path):
    people = ("ann", "ben", "cat", "dan")
    motion = synthetic_walkers(people, ("walk",), seconds=1.6, frame_rate=15.0)
    parts = split(motion)
    *others, last = parts
    monkeypatch.setattr(study, "training_motion", lambda data: concat([parts[o] for o in others]))
    monkeypatch.setattr(study, "read_clips", lambda names, data: {last: parts[last]})
    monkeypatch.setattr(study, "LONG", {last: (12, 10)})
    monkeypatch.setattr(study, "lengths_of", lambda part: (12, 10))
    monkeypatch.setattr(study, "MAX_STEPS", 5)
    views = {
        "at the mode": {"unknown_draws": 0, "context_weight": 1.0},
        "averaged": {"unknown_draws": 2, "context_weight": 0.5, "wander_sd": 0.1},
    }
    monkeypatch.setattr(study, "VIEWS", views)
    found = study.reproduce(None, tmp_path, say=lambda line: None)
    assert json.loads((tmp_path / "pace.json").read_text()) == json.loads(json.dumps(found))
    assert found["chosen"] in views
    for part, clips in (("left_out", others), ("test", [last])):
        assert list(found[part]) == [*views, *study.SIMPLE]
        for rows in found[part].values():
            assert sorted(rows) == sorted(clips)
    shown = page_block(report.markdown, found)
    assert f"**{found['chosen']}**" in shown
    assert "mixed smoothly" in shown


def test_the_defaults_are_what_the_landed_study_chose():
    landed = Path(__file__).parents[2] / "docs" / "results" / "pace.json"
    results = json.loads(landed.read_text(encoding="utf-8"))
    assert results["chosen"] == study.choose(results["left_out"])
    assert study.seen_by(Multifactor(), study.VIEWS[results["chosen"]]) == Multifactor()
