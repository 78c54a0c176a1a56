"""Joint gait-pose manifolds: walks around or on a torus, a cylinder, a circle."""

from .program import GaitPose
from .settings import (
    Around,
    Cylinder,
    LatentSpace,
    NoSurface,
    OnCylinder,
    OnSurface,
    OnTorus,
    PathDynamics,
    PoseCircle,
    Torus,
)
from .variants import SCALES, VARIANTS

__all__ = [
    "SCALES",
    "VARIANTS",
    "Around",
    "Cylinder",
    "GaitPose",
    "LatentSpace",
    "NoSurface",
    "OnCylinder",
    "OnSurface",
    "OnTorus",
    "PathDynamics",
    "PoseCircle",
    "Torus",
]
