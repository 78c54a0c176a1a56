"""Files of what was trained to recognise poses from voxels.

Kept as an `xarray.DataTree` like every fit: ``posterior`` holds one draw of the parameters
of the mixture or of the regression, ``vectors`` and ``pose`` what brings features to angles.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ..errors import InputError
from ..files import replacing
from ..models.mixture_em import Mixture
from ..models.pose_space import PoseSpace
from ..models.relevance_fast import Relevant
from ..motion import Skeleton
from ..sensing.shape_context import ShapeContext
from .voxel_pose import Regressor, Settings, VoxelPose

SCHEMA = 2
_DRAW = ("chain", "draw")


def save_voxel_pose(fit: VoxelPose, path: str | Path) -> None:
    """Write everything to one netCDF file; an older file stays until the new one is whole."""
    tree = regressor_tree(fit.regressor)
    mixture = {
        "weight": ("component",),
        "mean": ("component", "bin"),
        "factor": ("component", "bin", "latent"),
        "noise": ("component",),
    }
    sites = {name: _one_draw(getattr(fit.mixture, name), dims) for name, dims in mixture.items()}
    tree["posterior"] = xr.DataTree(tree["posterior"].to_dataset().assign(sites))
    tree.attrs |= {
        "kind": "voxel",
        "inference": "map",
        "settings": json.dumps(asdict(fit.settings)),
        "skeleton": fit.skeleton.to_json(),
        "rest": json.dumps(dict(fit.rest)),
        "seed": fit.seed,
        "seconds": fit.seconds,
    }
    with replacing(path) as temporary:
        tree.to_netcdf(temporary, engine="h5netcdf")


def load_voxel_pose(path: str | Path) -> VoxelPose:
    """Read back what `save_voxel_pose` wrote; it recognises exactly as before.

    Raises
    ------
    InputError
        If the file is not there, or is of another kind or schema.
    """
    tree = _opened(Path(path), "voxel")
    settings = json.loads(str(tree.attrs["settings"]))
    settings["context"] = ShapeContext(**settings["context"])
    one = tree["posterior"].to_dataset().isel(chain=0, draw=0)
    return VoxelPose(
        Settings(**settings),
        Mixture(*(one[name].values for name in ("weight", "mean", "factor", "noise"))),
        _regressor(tree),
        Skeleton.from_json(str(tree.attrs["skeleton"])),
        json.loads(str(tree.attrs["rest"])),
        int(tree.attrs["seed"]),
        float(tree.attrs["seconds"]),
    )


def save_regressor(regressor: Regressor, path: str | Path) -> None:
    """Write a regression alone."""
    with replacing(path) as temporary:
        regressor_tree(regressor).to_netcdf(temporary, engine="h5netcdf")


def load_regressor(path: str | Path) -> Regressor:
    """Read back what `save_regressor` wrote.

    Raises
    ------
    InputError
        If the file is not there, or is of another kind or schema.
    """
    return _regressor(_opened(Path(path), "regressor"))


def regressor_tree(regressor: Regressor) -> xr.DataTree:
    """Give a regression as a tree."""
    relevant, space = regressor.relevant, regressor.space
    posterior = xr.Dataset(
        {
            "alpha": _one_draw(relevant.alpha, ("basis",)),
            "beta": _one_draw(relevant.beta, ("output",)),
            "weights": _one_draw(relevant.mean, ("output", "basis")),
        }
    )
    vectors = xr.Dataset(
        {
            "kept": ("basis", relevant.kept),
            "vectors": (("basis", "feature"), regressor.vectors),
            "covariance": (("output", "basis", "basis_bis"), relevant.covariance),
            "held_out": ("output", regressor.held_out),
        }
    )
    pose = xr.Dataset(
        {
            "mean": ("circle", space.mean),
            "components": (("output", "circle"), space.components),
            "scale": ("output", space.scale),
            "rest": (("angle", "row", "column"), space.rest),
        },
        {"angle": list(space.labels)},
    )
    tree = xr.DataTree.from_dict({"posterior": posterior, "vectors": vectors, "pose": pose})
    tree.attrs = {
        "schema": SCHEMA,
        "kind": "regressor",
        "length_scale": regressor.length_scale,
        "log_marginal": relevant.log_marginal,
        "steps": relevant.steps,
        "converged": int(relevant.converged),
        "frames": regressor.of,
    }
    return tree


def _one_draw(value: np.ndarray, dims: tuple[str, ...]) -> tuple:
    return (*_DRAW, *dims), value[None, None]


def _opened(path: Path, kind: str) -> xr.DataTree:
    if not path.is_file():
        raise InputError(path, "there is no such file", "Fit with `bayesmotion fit voxel`")
    try:
        tree = xr.open_datatree(path, engine="h5netcdf").load()
    except (OSError, ValueError, KeyError) as error:
        raise InputError(path, f"it cannot be read ({error})", "Fit again") from error
    tree.close()
    if tree.attrs.get("kind") != kind or int(tree.attrs["schema"]) != SCHEMA:
        raise InputError(path, "it is no fit from voxels to poses", "Fit with `fit voxel`")
    return tree


def _regressor(tree: xr.DataTree) -> Regressor:
    one = tree["posterior"].to_dataset().isel(chain=0, draw=0)
    pose, vectors = tree["pose"].to_dataset(), tree["vectors"].to_dataset()
    attrs: Mapping[Any, Any] = tree.attrs
    relevant = Relevant(
        vectors["kept"].values,
        one["alpha"].values,
        one["beta"].values,
        one["weights"].values,
        vectors["covariance"].values,
        float(attrs["log_marginal"]),
        int(attrs["steps"]),
        bool(attrs["converged"]),
    )
    labels = tuple(map(str, pose["angle"].values))
    arrays = (pose[name].values for name in ("mean", "components", "scale", "rest"))
    space = PoseSpace(labels, *arrays)
    length = float(attrs["length_scale"])
    return Regressor(
        space,
        vectors["vectors"].values,
        length,
        relevant,
        vectors["held_out"].values,
        int(attrs["frames"]),
    )
