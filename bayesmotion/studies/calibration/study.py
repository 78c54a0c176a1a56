"""Simulation-based calibration of all models as they are shipped.

Every registered model, with its default settings, is drawn from its prior and fitted
`SIMULATIONS` times at a small size (`Model.sbc_case`); the ranks must be uniform. Gross faults
must each be found out; of subtle ones the study says how often a calibration of that size
finds them: `Plan.batches` times as many simulations are made for that.

A right model is refused now and then: where few true values are drawn from a prior that the data
say little about, their luck is that of the ranks. So a refused model is calibrated once more, with
that many simulations from another seed, and that one decides. Both are in the results.

Each model has a file of its own in the folder of results, whose stages are not done again, and
``calibration.json`` joins them.
"""

from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...evaluate.sbc.calibration import SIMULATIONS, calibrate
from ...evaluate.sbc.chains import Chains
from ...evaluate.sbc.controls import GROSS, SUBTLE
from ...evaluate.sbc.rank_test import LEVEL, power, summary
from ...files import write_json
from ...model import Model
from ...registry import describe_model, model_class, model_names
from ..stages import Say, Stages

CHAINS = Chains()


@dataclass(frozen=True)
class Plan:
    """Settings of the study.

    simulations
        Of each calibration.
    batches
        So many times as many are made with subtle faults.
    chains
        How chains are run.
    seed
        The one seed.
    """

    simulations: int = SIMULATIONS
    batches: int = 3
    chains: Chains = CHAINS
    seed: int = 0


def shipped_models() -> dict[str, Any]:
    """Return every registered model that says how it is calibrated, with its default settings.

    Models whose settings have no defaults are as in their example.
    """
    out = {}
    for name in model_names():
        kind = model_class(name)
        if hasattr(kind, "sbc_case"):
            out[name] = default_model(kind)
    return out


def default_model(kind: Any) -> Any:
    """Return a model with its default settings, of its example where there are none."""
    usual = (field.default is not MISSING or field.default_factory is not MISSING
             for field in fields(kind))  # fmt: skip
    return kind() if all(usual) else kind.example()[0]


def reproduce(data: Path | None, out: Path, say: Say = print) -> dict[str, Any]:
    """Calibrate all models as shipped and write ``calibration.json``.

    Parameters
    ----------
    data
        Not needed: everything is simulated.
    out
        Folder for the results.
    say
        Called with a line after every stage.
    """
    return calibrate_all(shipped_models(), out, Plan(), say)


def plan(seed: int = 0) -> dict[str, Any]:
    """The settings of the study."""
    return {**asdict(Plan(seed=seed)), "level": LEVEL}


def calibrate_all(
    models: Mapping[str, Model], out: Path, plan: Plan, say: Say = print
) -> dict[str, Any]:
    """Calibrate models one by one, each resumed where it was interrupted.

    Parameters
    ----------
    models
        By the name they have in the results.
    out
        Folder for ``calibration.json`` and one file a model.
    plan
        Settings of the study.
    say
        Called with a line after every stage.
    """
    result: dict[str, Any] = {"settings": {**asdict(plan), "level": LEVEL}, "models": {}}
    commits: dict[str, None] = {}
    for name, model in models.items():
        settings = {"plan": asdict(plan), "level": LEVEL, "model": describe_model(model)}
        stages = Stages(
            out / f"calibration-{name}.json", settings, lambda t, n=name: say(f"{n} {t}")
        )
        calibrate_one(model, plan, stages)
        result["models"][name] = stages.result
        result["to_come"] = [other for other in models if other not in result["models"]]
        commits |= dict.fromkeys(stages.result["made_with"]["commits"])
        result["made_with"] = stages.result["made_with"] | {"commits": list(commits)}
        write_json(out / "calibration.json", result)
    return result


def calibrate_one(model: Model, plan: Plan, stages: Stages) -> None:
    """Calibrate a model, and every control of it; each is a stage."""
    try:
        model.sbc_case()
    except InputError as error:
        reason = str(error)
        # A model without draws is not calibrated; the table says why.
        stages.do("refused", work=lambda: reason)
        return

    many = plan.batches * plan.simulations

    def run(control: str, simulations: int, seed: int = plan.seed) -> Any:
        return calibrate(model, simulations=simulations, seed=seed, control=control,
                         chains=plan.chains)  # fmt: skip

    first = stages.do("none", work=lambda: summary(run("none", plan.simulations)))
    if not first["calibrated"]:
        stages.do("again", work=lambda: summary(run("none", many, plan.seed + 1)))
    for control in GROSS:
        stages.do("gross", control, work=lambda c=control: summary(run(c, plan.simulations)))
    for control in SUBTLE:

        def work(control: str = control) -> dict[str, Any]:
            tree = run(control, many)
            return {**summary(tree), "power": power(tree, plan.simulations)._asdict()}

        stages.do("subtle", control, work=work)
