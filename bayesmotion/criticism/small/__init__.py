"""Small versions of the models, for checks that fit them hundreds of times.

One module a model, of the model's name; its function ``trial`` gives by its kind what
`criticism.calibration.calibrate_case` takes: the trial, and its data.
"""

import importlib
from typing import TYPE_CHECKING, Any

from ...errors import InputError

if TYPE_CHECKING:
    from ...model import SBCCase

# Of every model the kinds that can be calibrated, the first of them by default.
KINDS: dict[str, tuple[str, ...]] = {
    "multifactor": ("circle_drift", "circle_white", "circle_own_drift", "gp_first", "gp_second"),
    "tensor": ("tensor",),
    "relevance_vector": ("relevance_vector",),
    "mixture_ppca": ("mixture_ppca",),
    "shared-gplvm": ("free",),
    "gait-pose": ("gplvm", "torus", "cylinder", "on_torus"),
}
# And those that cannot: nothing can be drawn from them, or by a density that is known.
REFUSED: dict[str, tuple[str, ...]] = {
    "multifactor": ("gp_balanced",),
    "shared-gplvm": ("constrained", "dynamic"),
    "gait-pose": ("gpdm", "ll_gpdm"),
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
    module = importlib.import_module(f".{model.replace('-', '_')}", __name__)
    return module.trial(kind)
