"""A fitted model: the training motion, the model with its settings, and the draws.

A fit is kept as an `xarray.DataTree` with ArviZ's group names: ``posterior``
(chain, draw, ...), ``sample_stats``, ``observed_data``, ``constant_data`` and, so
that the fit can predict, ``motion`` with the training clips. A point estimate is
a posterior of one draw. `Fit.save` writes one netCDF file, `load` reads it back.
"""

import hashlib
import importlib.metadata
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import xarray as xr

from .errors import InputError
from .files import replacing
from .models.multifactor import Factor, Given, Multifactor
from .models.poses import (
    Frames,
    PoseEncoding,
    clip_labels,
    frames_of,
    learn_encoding,
    level_names,
)
from .motion.joining import split

SCHEMA = 1
PACKAGES = ("bayesmotion", "numpyro", "jax", "arviz", "xarray", "numpy")


@dataclass(frozen=True)
class Training:
    """Training clips as a model sees them.

    encoding
        How poses become features.
    frames
        The arrays for the program.
    levels
        For each factor the names of the known levels; unknown ones follow them.
    clips
        Names of the clips.
    """

    encoding: PoseEncoding
    frames: Frames
    levels: dict[str, list[str]]
    clips: tuple[str, ...]


def prepare(
    motion: xr.Dataset, factors: tuple[str, ...], *, centre: bool = False, turned: bool = False
) -> Training:
    """Make training clips into arrays.

    Parameters
    ----------
    motion
        Clips with a text label for each factor ("" where unknown).
    factors
        Names of the style factors.
    centre, turned
        Whether features are centred, and whether each clip's heading is taken out.

    Raises
    ------
    InputError
        If a label is missing, a factor is known for no clip, or skeletons disagree.
    """
    encoding = learn_encoding(motion, centre=centre, turned=turned)
    labels = {factor: clip_labels(motion, factor) for factor in factors}
    levels = {factor: level_names(motion, factor) for factor in factors}
    parts = {
        clip: encoding.scaled(encoding.features(part, encoding.heading(part)))
        for clip, part in split(motion).items()
    }
    return Training(encoding, frames_of(parts, labels, levels), levels, tuple(parts))


@dataclass(frozen=True)
class Fit:
    """A model, the clips it was trained on, and its posterior.

    model
        The model with its settings.
    motion
        The training clips.
    tree
        ArviZ groups; ``posterior`` has the dimensions chain and draw.
    """

    model: Multifactor
    motion: xr.Dataset
    tree: xr.DataTree

    @cached_property
    def training(self) -> Training:
        """The training clips as the model sees them."""
        return prepare(
            self.motion,
            tuple(factor.name for factor in self.model.factors),
            centre=bool(self.tree.attrs["centre"]),
            turned=bool(self.tree.attrs["turned"]),
        )

    def values(self, chain: int = 0, draw: int = 0) -> dict[str, np.ndarray]:
        """Give the site values of one draw."""
        posterior = self.tree["posterior"].ds.isel(chain=chain, draw=draw)
        return {str(name): posterior[name].values for name in posterior.data_vars}

    def stats(self, chain: int = 0, draw: int = 0) -> dict[str, float]:
        """Give the sampler's or optimiser's figures of one draw (lp, steps, converged)."""
        stats = self.tree["sample_stats"].to_dataset().isel(chain=chain, draw=draw)
        return {str(name): float(stats[name]) for name in stats.data_vars}

    @cached_property
    def given(self) -> Given:
        """The model conditioned on its training clips, at the first draw."""
        values = {name: jnp.asarray(value) for name, value in self.values().items()}
        return self.model.given(self.training.frames, values)

    def save(self, path: str | Path) -> None:
        """Write the fit to one netCDF file; an older file stays until the new one is whole."""
        tree = self.tree.copy()
        tree["motion"] = xr.DataTree(self.motion)
        tree.attrs["model"] = json.dumps(describe_model(self.model))
        with replacing(path) as temporary:
            tree.to_netcdf(temporary, engine="h5netcdf")


def load(path: str | Path) -> Fit:
    """Read a fit back; it predicts exactly as it did before it was saved.

    Raises
    ------
    InputError
        If the file is not there, is no fit, or was written with another schema.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(path, "there is no such file", "Check the path, or fit a model first")
    try:
        tree = xr.open_datatree(path, engine="h5netcdf").load()
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            path, f"it cannot be read as netCDF ({error})", "Fit the model again"
        ) from error
    tree.close()
    schema = tree.attrs.get("schema")
    if schema is None or "model" not in tree.attrs or "motion" not in tree.children:
        raise InputError(path, "it is no fit of bayesmotion", "Give a file written by a fit")
    if int(schema) != SCHEMA:
        raise InputError(
            path, f"it has schema {schema}, this version reads schema {SCHEMA}", "Fit again"
        )
    model = build_model(json.loads(str(tree.attrs["model"])), path)
    motion = tree["motion"].to_dataset()
    return Fit(model, motion, tree.filter(lambda node: node.name != "motion"))


def describe_model(model: Multifactor) -> dict[str, Any]:
    """Give a model's name and settings as plain values."""
    return {"name": model.name, **asdict(model)}


def build_model(settings: Mapping[str, Any], where: object) -> Multifactor:
    """Make the model that `describe_model` described.

    Raises
    ------
    InputError
        If it is a model this version does not know.
    """
    settings = dict(settings)
    name = settings.pop("name", None)
    if name != Multifactor.name:
        raise InputError(
            where, f"it holds a fit of {name!r}", f"Give a fit of {Multifactor.name!r}"
        )
    factors = tuple(Factor(**factor) for factor in settings.pop("factors"))
    return Multifactor(**settings, factors=factors)


def data_hash(training: Training) -> str:
    """Give a hash of the arrays a model was fitted to (values, clips and labels)."""
    digest = hashlib.sha256()
    frames = training.frames
    arrays = [frames.y, frames.missing.rows, frames.missing.columns, frames.clip]
    for array in [*arrays, *(frames.level[name] for name in sorted(frames.level))]:
        contiguous = np.ascontiguousarray(array)
        digest.update(str(contiguous.shape).encode())
        digest.update(contiguous.tobytes())
    return digest.hexdigest()


def versions() -> str:
    """Give the versions of the packages a fit depends on, as JSON."""
    return json.dumps({name: importlib.metadata.version(name) for name in PACKAGES})
