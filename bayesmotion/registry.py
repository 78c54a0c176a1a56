"""The models by name: those of the collection, and those of others."""

import importlib
from collections.abc import Mapping
from importlib.metadata import EntryPoints, entry_points
from typing import TYPE_CHECKING, Any

from .errors import InputError
from .model import Fittable, Model
from .settings import TYPE, plain, restored_class

if TYPE_CHECKING:
    ModelClass = type[Model]
else:
    ModelClass = type


# Every model by its name: the module and the class. Further ones come by `register`, or as
# entry points of the group ``bayesmotion.models`` of installed packages.
_OWN = {
    "multifactor": "bayesmotion.models.multifactor:Multifactor",
    "keyposes": "bayesmotion.models.keyposes:Keyposes",
    "motion_tensor": "bayesmotion.models.motion_tensor:MotionTensor",
    "gait_pose": "bayesmotion.models.gait_pose:GaitPose",
    "mixture_ppca": "bayesmotion.models.voxel_pose.mixture_ppca:MixturePPCA",
    "relevance_vectors": "bayesmotion.models.voxel_pose.relevance_vectors:RelevanceVectors",
    "voxel_pose": "bayesmotion.models.voxel_pose:VoxelPose",
    "shared_gplvm": "bayesmotion.models.shared_gplvm:SharedGPLVM",
    "voice_puppetry": "bayesmotion.models.voice_puppetry:VoicePuppetry",
}
_REGISTERED: dict[str, type] = {}


def register(kind: type) -> type:
    """Make a model known by its name, so that its fits can be loaded; usable as a decorator.

    Raises
    ------
    InputError
        If another model has the name.
    """
    name = getattr(kind, "name", None)
    if not isinstance(name, str):
        raise InputError(f"{kind.__name__}", "it has no name", "Give the class a `name`")
    known = model_names()
    if name in known and _REGISTERED.get(name) is not kind:
        raise InputError(f"model {name!r}", "there is one of this name", "Choose another name")
    _REGISTERED[name] = kind
    return kind


def model_names() -> list[str]:
    """Return the names of all models."""
    return list(dict.fromkeys([*_OWN, *(e.name for e in _plugins()), *_REGISTERED]))


def model_class(name: str, where: object = "bayesmotion") -> ModelClass:
    """Return the class of a model.

    Parameters
    ----------
    name
        Of the model.
    where
        Where the name stands, for the error.

    Raises
    ------
    InputError
        If there is no model of this name.
    """
    if name in _REGISTERED:
        return _REGISTERED[name]
    if name in _OWN:
        module, kind = _OWN[name].split(":")
        return getattr(importlib.import_module(module), kind)
    for entry in _plugins():
        if entry.name == name:
            return entry.load()
    raise InputError(where, f"there is no model {name!r}", f"Known are {', '.join(model_names())}")


def _plugins() -> EntryPoints:
    return entry_points(group="bayesmotion.models")


def describe_model(model: Fittable) -> dict[str, Any]:
    """Return a model's name and settings as plain values."""
    settings = plain(model)
    del settings[TYPE]
    return {"name": model.name, **settings}


def build_model(settings: Mapping[str, Any], where: object) -> Model:
    """Make the model that `describe_model` described.

    Raises
    ------
    InputError
        If it is a model this version does not know, or with other settings.
    """
    if not isinstance(settings, Mapping):
        raise InputError(where, "it describes no model", "Fit again")
    settings = dict(settings)
    kind = model_class(str(settings.pop("name", None)), where)
    try:
        return restored_class(kind, settings)
    except (TypeError, LookupError) as error:
        raise InputError(
            where, f"its settings of {kind.name!r} are of another version ({error})", "Fit again"
        ) from error
