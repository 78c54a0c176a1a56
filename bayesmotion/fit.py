"""A fitted model: the training motion, the model with its settings, and the draws.

A fit is kept as an `xarray.DataTree` with ArviZ's group names: ``posterior``
(chain, draw, ...), ``sample_stats``, ``log_likelihood``, ``log_prior``,
``observed_data``, ``constant_data`` (see `inference.results`) and, so that the fit can
predict, ``motion`` with the training clips. A point estimate is a posterior of one draw.
`Fit.save` writes one netCDF file, `load` reads it back.
"""

import json
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path

import numpy as np
import xarray as xr

from .errors import InputError
from .files import FIT
from .fit_validation import require_draws, require_tree
from .model import Fittable, ProgramData
from .motion.dataset import label_names
from .netcdf import read_netcdf, write_netcdf
from .programs import one_at_a_time
from .registry import build_model, describe_model

SCHEMA = 3


@dataclass(frozen=True, repr=False)
class Fit:
    """A model, the clips it was trained on, and its posterior.

    model
        The model with its settings.
    motion
        The training clips.
    tree
        ArviZ groups; ``posterior`` has the dimensions chain and draw.
    """

    model: Fittable
    motion: xr.Dataset
    tree: xr.DataTree

    @cached_property
    def training(self) -> ProgramData:
        """The training clips as the model sees them."""
        return self.model.prepare(self.motion)

    @property
    def frame_rate(self) -> float:
        """Frames a second of the training clips."""
        return float(self.motion.attrs["frame_rate"])

    @property
    def labels(self) -> dict[str, list[str]]:
        """The levels of every label of the training clips that are known, in their order."""
        levels = {name: self.motion[name].values.tolist() for name in label_names(self.motion)}
        return {
            name: [one for one in dict.fromkeys(there) if one] for name, there in levels.items()
        }

    @property
    def point_estimate(self) -> bool:
        """Whether there is one draw: a point estimate has no R-hat, and no weights."""
        sizes = self.tree["posterior"].sizes
        return sizes["chain"] * sizes["draw"] == 1

    def values(self, chain: int = 0, draw: int = 0) -> dict[str, np.ndarray]:
        """Give the site values of one draw."""
        posterior = self.tree["posterior"].ds.isel(chain=chain, draw=draw)
        return {str(name): posterior[name].values for name in posterior.data_vars}

    def stats(self, chain: int = 0, draw: int = 0) -> dict[str, float]:
        """Give the sampler's or optimiser's figures of one draw (lp, steps, converged)."""
        stats = self.tree["sample_stats"].to_dataset().isel(chain=chain, draw=draw)
        return {str(name): float(stats[name]) for name in stats.data_vars}

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to know before trusting the fit, in sentences."""
        return tuple(json.loads(str(self.tree.attrs["warnings"])))

    def summary(self) -> list[tuple[str, str]]:
        """Return what was fitted, to what and how, warnings first."""
        sizes = self.tree["posterior"].sizes
        drawn = "1 draw: a point estimate, intervals leave out how unsure the model is"
        if not self.point_estimate:
            drawn = f"{sizes['chain']} x {sizes['draw']} draws"
        shapes = ", ".join(
            f"{name} ({', '.join(f'{dim}: {size}' for dim, size in array.sizes.items())})"
            for name, array in self.tree["observed_data"].to_dataset().data_vars.items()
        )
        settings = ", ".join(
            f"{k}={v!r}" for k, v in json.loads(self.tree.attrs["settings"]).items()
        )
        return [
            *(("warning", text) for text in self.warnings),
            ("model", repr(self.model)),
            ("data", shapes),
            ("method", f"{self.tree.attrs['inference']} ({settings})"),
            ("posterior", drawn),
        ]

    def __repr__(self) -> str:
        """Return the summary as text."""
        lines = [f"  {name:<10}{text}" for name, text in self.summary()]
        return "\n".join([f"Fit of {self.model.name}", *lines])

    def _repr_html_(self) -> str:
        """Return the summary as a table, as notebooks show it."""
        rows = "".join(
            f"<tr><th style='text-align:left'>{escape(name)}</th><td>{escape(text)}</td></tr>"
            for name, text in self.summary()
        )
        return f"<b>Fit of {escape(self.model.name)}</b><table>{rows}</table>"

    def save(self, path: str | Path) -> None:
        """Write the fit to one netCDF file; an older file stays until the new one is whole.

        Raises
        ------
        InputError
            If the name does not end in ``.nc``, or there is a file that holds no fit.
        OSError
            If it cannot be written, as on a full disk; the fit stays as it is.
        """
        FIT.check(path)
        tree = self.tree.copy()
        # Settings that say how new clips are seen may have been changed since it was fitted.
        tree.attrs = {**tree.attrs, "model": json.dumps(describe_model(self.model))}
        tree["motion"] = xr.DataTree(self.motion)
        write_netcdf(path, tree)


@one_at_a_time
def load(path: str | Path) -> Fit:
    """Read a fit back; it predicts exactly as it did before it was saved.

    Raises
    ------
    InputError
        If the file is not there, is no fit, was written with another schema, is damaged, or
        holds other values than were saved.
    """
    tree = read_netcdf(path, "Get the file again, or fit the model again")
    schema = tree.attrs.get("schema")
    if schema is None or "model" not in tree.attrs or "motion" not in tree.children:
        raise InputError(path, "it is no fit of bayesmotion", "Give a file written by a fit")
    if schema != SCHEMA:
        raise InputError(
            path, f"it has schema {schema}, this version reads schema {SCHEMA}", "Fit again"
        )
    require_tree(tree, path)
    model = build_model(json.loads(str(tree.attrs["model"])), path)
    motion = tree["motion"].to_dataset()
    found = Fit(model, motion, tree.filter(lambda node: node.name != "motion"))
    require_draws(found, path)
    return found
