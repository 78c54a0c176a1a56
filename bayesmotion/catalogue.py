"""The models of the collection as a table, and an example of each.

What a model answers is found by asking it, by the small protocols of `model` and by what tasks
ask for.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import pandas as pd
import xarray as xr

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
from .models.gait_pose import GaitPose
from .models.motion_tensor import MotionTensor
from .models.multifactor import Multifactor
from .models.voxel_pose import VoxelPose
from .registry import model_class, model_names

Question = Callable[[Model, Data], bool]

# What every model answers: the verbs of `Model` are all that these ask for.
ALL = (
    "fit", "predict", "identified", "diagnose", "leave_one_out", "compare", "calibrate",
    "predictive_check", "predictive_groups", "prior_sensitivity",
)  # fmt: skip
# What some do: whether a model (as its example has it) and its data are what the task takes.
TASKS: dict[str, Question] = {
    "forecast": lambda model, data: isinstance(data, AngleData),
    "reconstruct": lambda model, data: isinstance(data, MotionData) or isinstance(model, GaitPose),
    "denoise": lambda model, data: isinstance(model, GaitPose),
    "synthesize": lambda model, data: isinstance(model, Multifactor) and model.on_circle,
    "recognize": lambda model, data: isinstance(model, MotionTensor),
    "recognize_pose": lambda model, data: isinstance(model, VoxelPose),
    "audio_to_face": lambda model, data: {"audio", "face"} <= set(data.units()),
}
FURTHER: dict[str, Question] = {
    "aligned": lambda model, data: isinstance(
        model, RotationInvariant | ScaleInvariant | PermutationInvariant | PhaseInvariant
    ),
    "leave_one_out by entry": lambda model, data: isinstance(model, LeavesEntriesOut),
    "sites integrated out": lambda model, data: isinstance(model, Marginalised),
    "files on the command line": lambda model, data: isinstance(model, ReadsFiles),
}


def models() -> pd.DataFrame:
    """Return a table of all models: class, paper, recordings, methods, tasks, and what else.

    Every model is fitted, predicts, and is diagnosed, scored, compared, checked and calibrated;
    ``tasks`` are those of single models, and ``further`` what criticism and the command line
    can do beyond that.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> bm.models().loc["multifactor", "tasks"]
    'forecast, reconstruct, synthesize'
    """
    rows = {}
    for name in model_names():
        kind = model_class(name)
        rows[name] = {
            "class": kind.__name__,
            "paper": kind.about.paper,
            "recordings": kind.about.recordings,
            "methods": ", ".join(kind.about.methods),
            **_answers(kind),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("model")


@cache
def _answers(kind: Any) -> dict[str, str]:
    """Return what a model answers beside what all do, as its example has it."""
    model, recordings = kind.example()
    data = model.prepare(recordings)

    def names(questions: dict[str, Question]) -> str:
        return ", ".join(name for name, answers in questions.items() if answers(model, data))

    return {"tasks": names(TASKS), "further": names(FURTHER)}


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
