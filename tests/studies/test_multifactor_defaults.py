"""The defaults of the multifactor model are what training people chose."""

import json
from pathlib import Path

from bayesmotion.models.multifactor import OU, Factor, Multifactor
from bayesmotion.motion.synthetic.walkers import synthetic_walkers
from bayesmotion.studies.multifactor import defaults as multifactor_defaults
from bayesmotion.studies.multifactor.defaults import best
from bayesmotion.studies.multifactor.study import MODELS

ROOT = Path(__file__).parent.parent.parent


def test_the_highest_log_score_chooses_and_then_the_smallest_error():
    rows = [
        {"log_score": 1.0, "error": 0.5},
        {"log_score": 2.0, "error": 0.9},
        {"log_score": 2.0, "error": 0.7},
    ]
    assert best(rows) == rows[2]


def test_the_defaults_are_what_the_landed_study_chose():
    results = json.loads((ROOT / "docs/results/multifactor.json").read_text(encoding="utf-8"))
    tried, chosen = results["defaults"]["tried"], results["defaults"]["chosen"]
    assert len(tried) == 8
    assert chosen == best(tried)
    assert Multifactor().residual == OU(per_clip=chosen["per_clip"])
    assert Multifactor().student_df == chosen["student_df"]
    assert {factor.novel_dims for factor in Multifactor().factors} == {chosen["novel_dims"]}
    assert Factor("mood").novel_dims == chosen["novel_dims"]


def test_the_plain_models_of_the_study_are_named_as_such():
    for name, model in MODELS.items():
        if name != "cdm_style_default":
            assert model.student_df is None
            assert all(factor.novel_dims == 0 for factor in model.factors)
    assert MODELS["cdm_style"].residual == OU(per_clip=False)
    # Its clips are seen at the modes of their unknowns, as its results were made.
    assert MODELS["cdm_style_default"] == Multifactor(unknown_draws=0, context_weight=1.0)


def test_every_combination_is_tried_on_everybody_left_out(monkeypatch):
    trained = []

    def left_out(motion, train, novel_dims, student_dfs):
        trained.append(train(motion))
        score = {"error": 1.0, "crps": 0.1, "log_score": float(not trained[-1])}
        score |= {"coverage90": 0.9}
        return {
            str(novel): {"scores": {str(df): score for df in student_dfs}} for novel in novel_dims
        }

    monkeypatch.setattr(multifactor_defaults, "leave_subjects_out", left_out)
    monkeypatch.setattr(multifactor_defaults, "_train", lambda per_clip, *how: per_clip)
    motion = synthetic_walkers(("ann", "ben"), ("walk", "run"), seconds=0.5)
    found = multifactor_defaults.choose_defaults(motion, max_steps=10, seed=0)
    assert trained == [False, True]
    assert len({str(row) for row in found["tried"]}) == 8
    assert found["chosen"]["per_clip"] is False
