"""The settings of gait-pose models that are calibrated, by name."""

from dataclasses import replace

from ...model import SBCCase
from ...models.gait_pose import VARIANTS, Circle, Cylinder, GaitPose
from ...models.gait_pose.data import Cycles

MODELS: dict[str, GaitPose] = {
    "torus": GaitPose(),
    "cylinder": GaitPose(Cylinder()),
    "circle": GaitPose(Circle()),
    "gplvm": VARIANTS["gplvm"],
    "on_torus": VARIANTS["on_torus1"],
    "on_cylinder": replace(VARIANTS["on_cylinder3"], scales=(1.0,)),
    "gpdm": VARIANTS["gpdm"],
    "ll_gpdm": VARIANTS["ll_gpdm"],
}


def trial(kind: str) -> tuple[SBCCase, Cycles]:
    """Return the small model of a kind and its data.

    Raises
    ------
    InputError
        If it cannot be drawn from.
    """
    return MODELS[kind].sbc_case()
