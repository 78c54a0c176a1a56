"""Motion capture: reading, writing, checking and preparing recordings."""

import importlib
from typing import TYPE_CHECKING, Any

from .cycles import cycles_of, diversified
from .dataset import (
    clips,
    label_names,
    make_markers,
    make_motion,
    skeleton_of,
    skeletons,
)
from .io.acclaim import write_amc, write_asf
from .io.amc import read_amc
from .io.asf import read_asf
from .io.bvh import read_bvh, write_bvh
from .io.c3d import read_c3d
from .io.labels import Labels, read_labels, with_labels
from .io.reading import load, read, save, write
from .joining import concat, split
from .kinematics import positions
from .quality.check import check
from .quality.findings import Finding, describe, drop
from .resampling import downsample, resample
from .roles import joint_roles, with_joints
from .skeleton import Joint, Skeleton

if TYPE_CHECKING:
    from .differentiable import forward, rotations

# Recordings are read and checked without JAX, which these are made of.
_OF_JAX = ("forward", "rotations")

__all__ = [
    "Finding",
    "Joint",
    "Labels",
    "Skeleton",
    "check",
    "clips",
    "concat",
    "cycles_of",
    "describe",
    "diversified",
    "downsample",
    "drop",
    "forward",
    "joint_roles",
    "label_names",
    "load",
    "make_markers",
    "make_motion",
    "positions",
    "read",
    "read_amc",
    "read_asf",
    "read_bvh",
    "read_c3d",
    "read_labels",
    "resample",
    "rotations",
    "save",
    "skeleton_of",
    "skeletons",
    "split",
    "with_joints",
    "with_labels",
    "write",
    "write_amc",
    "write_asf",
    "write_bvh",
]


def __getattr__(name: str) -> Any:
    """Import what is made of JAX when it is first asked for."""
    if name in _OF_JAX:
        return getattr(importlib.import_module(".differentiable", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
