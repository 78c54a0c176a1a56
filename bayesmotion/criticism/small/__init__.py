"""Small versions of the models, for checks that fit them hundreds of times.

A model in a package of its own makes its small version itself (`Model.sbc_case`), the kind
``default``. For others there is one module, of the model's name; its function ``trial`` gives
by its kind what `criticism.calibration.calibrate` takes: the trial, and its data.
"""

import importlib
from typing import TYPE_CHECKING, Any

from ...errors import InputError
from ...model import model_class

if TYPE_CHECKING:
    from ...model import SBCCase

# Of every model the kinds that can be calibrated, the first of them by default.
KINDS: dict[str, tuple[str, ...]] = {
    "motion_tensor": ("default",),
    "keyposes": ("default",),
    "relevance_vector": ("relevance_vector",),
    "mixture_ppca": ("mixture_ppca",),
    "voxel_pose": ("voxel_pose",),
    "shared-gplvm": ("free",),
    "gait_pose": ("torus", "cylinder", "circle", "gplvm", "on_torus", "on_cylinder"),
}
# Of these the case is the model's own.
OF_THE_MODEL = ("relevance_vectors", "mixture_ppca", "voxel_pose")
# And those that cannot: nothing can be drawn from them, or by a density that is known.
REFUSED: dict[str, tuple[str, ...]] = {
    "shared-gplvm": ("constrained", "dynamic"),
    "gait_pose": ("gpdm", "ll_gpdm"),
}


def small_trial(model: str, kind: str | None = None) -> tuple["SBCCase", Any]:
    """Give the small version of a model and its data.

    Parameters
    ----------
    model
        The model's name.
    kind
        One of its `KINDS`; the first where None.

    Raises
    ------
    InputError
        If there is no such model or kind, or the kind cannot be drawn from.
    """
    if model not in KINDS:
        raise InputError(repr(model), "there is no such model", f"Use {', '.join(KINDS)}")
    kind = KINDS[model][0] if kind is None else kind
    known = KINDS[model] + REFUSED.get(model, ())
    if kind not in known:
        raise InputError(repr(kind), f"{model} has no such kind", f"Use {', '.join(KINDS[model])}")
    if kind == "default":
        return model_class(model)().sbc_case()
    module = importlib.import_module(f".{model.replace('-', '_')}", __name__)
    return module.trial(kind)
