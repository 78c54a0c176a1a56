"""The models of the collection as a table, and an example of each.

What a model answers is found by asking it, by the small protocols of `model` and `verbs`.
"""

from functools import cache

import pandas as pd
import xarray as xr

from .errors import InputError
from .model import (
    AngleData,
    Data,
    LeavesEntriesOut,
    Marginalised,
    Model,
    MotionData,
    PermutationInvariant,
    PhaseInvariant,
    ReadsFiles,
    RotationInvariant,
    ScaleInvariant,
)
from .registry import ModelClass, model_class, model_names
from .verbs import (
    ConditionsOnCycles,
    DecodesPoses,
    FollowsClips,
    MovesByStyle,
    RecognizesLevels,
    RelatesViews,
)

# What every model answers: the verbs of `Model` are all that these ask for.
ALL = (
    "fit", "predict", "identified", "diagnose", "leave_one_out", "compare", "calibrate",
    "predictive_check", "predictive_groups", "prior_sensitivity",
)  # fmt: skip
# What some do: the task, and the verbs of which a model or its data has one.
TASKS: dict[str, tuple[type, ...]] = {
    "forecast": (AngleData,),
    "online": (FollowsClips,),
    "reconstruct": (MotionData, ConditionsOnCycles),
    "denoise": (ConditionsOnCycles,),
    "synthesize": (MovesByStyle,),
    "recognize": (RecognizesLevels,),
    "recognize_pose": (DecodesPoses,),
    "audio_to_face": (RelatesViews,),
}
FURTHER: dict[str, tuple[type, ...]] = {
    "aligned": (RotationInvariant, ScaleInvariant, PermutationInvariant, PhaseInvariant),
    "leave_one_out by entry": (LeavesEntriesOut,),
    "sites integrated out": (Marginalised,),
    "files on the command line": (ReadsFiles,),
}


def models() -> pd.DataFrame:
    """Return a table of all models: class, paper, recordings, methods, tasks, and what else.

    Every model is fitted, predicts, and is diagnosed, scored, compared, checked and calibrated;
    ``tasks`` are those of single models, and ``further`` what criticism and the command line
    can do beyond that. A registered model without `Model.example` has the verbs of `Fittable`
    at most: it is fitted, saved and loaded, and has no row.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> bm.models().loc["multifactor", "tasks"]
    'forecast, online, reconstruct, synthesize'
    """
    rows = {}
    for name, kind in _shown().items():
        rows[name] = {
            "class": kind.__name__,
            "paper": kind.about.paper,
            "recordings": kind.about.recordings,
            "methods": ", ".join(kind.about.methods),
            "tasks": _answered(kind, TASKS),
            "further": _answered(kind, FURTHER),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("model")


def lacking(name: str, what: str, *verbs: type) -> InputError:
    """Return the refusal of a model that lacks a verb; it names the models that have it.

    Parameters
    ----------
    name
        Of the model.
    what
        What it does not do, in a few words.
    verbs
        Protocols of models or of their data, any of which would do.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> from bayesmotion.catalogue import lacking
    >>> from bayesmotion.verbs import DecodesPoses
    >>> print(lacking("keyposes", "it recognises no poses", DecodesPoses))
    model 'keyposes': it recognises no poses. Fit voxel_pose.
    """
    able = [one for one, kind in _shown().items() if _has(kind, verbs)]
    return InputError(f"model {name!r}", what, f"Fit {' or '.join(able)}")


def _shown() -> dict[str, ModelClass]:
    """Return the models that show what they do by an example, by their names."""
    kinds = {name: model_class(name) for name in model_names()}
    return {name: kind for name, kind in kinds.items() if hasattr(kind, "example")}


def _answered(kind: ModelClass, questions: dict[str, tuple[type, ...]]) -> str:
    return ", ".join(name for name, verbs in questions.items() if _has(kind, verbs))


def _has(kind: ModelClass, verbs: tuple[type, ...]) -> bool:
    """Whether a model, as its example has it, or its data has one of the verbs."""
    return any(isinstance(one, verbs) for one in _example(kind))


@cache
def _example(kind: ModelClass) -> tuple[Model, Data]:
    model, recordings = kind.example()
    return model, model.prepare(recordings)


def example(name: str, seed: int = 0) -> tuple[Model, xr.Dataset]:
    """Return a small model and recordings made for it.

    Parameters
    ----------
    name
        Of the model; `models` lists them.
    seed
        Of the recordings.

    Raises
    ------
    InputError
        If there is no such model.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> model, recordings = bm.example("multifactor")
    """
    return model_class(name).example(seed)
