"""Joint gait-pose manifolds: walks around or on a torus, a cylinder, a circle."""

from .program import GaitPose
from .settings import (
    Around,
    Circle,
    Cylinder,
    LatentSpace,
    NoSurface,
    OnCylinder,
    OnSurface,
    OnTorus,
    PathDynamics,
    Torus,
)
from .variants import SCALES, VARIANTS

__all__ = [
    "SCALES",
    "VARIANTS",
    "Around",
    "Circle",
    "Cylinder",
    "GaitPose",
    "LatentSpace",
    "NoSurface",
    "OnCylinder",
    "OnSurface",
    "OnTorus",
    "PathDynamics",
    "Torus",
]
