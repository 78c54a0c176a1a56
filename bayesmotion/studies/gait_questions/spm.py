"""What spm1d has: data sets that come with it, and its t tests by random field theory."""

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...errors import InputError
from ...motion.io.curves import read_curves
from ...tasks.contrast_design import design_of

A, B = {"condition": "a"}, {"condition": "b"}


def spm1d() -> Any:
    """Return the package.

    Raises
    ------
    InputError
        If it is not installed.
    """
    try:
        return importlib.import_module("spm1d")
    except ModuleNotFoundError as error:
        raise InputError(
            "the package 'spm1d'", "it is not installed",
            "Install the dependency group peers: uv sync --group peers",
        ) from error  # fmt: skip


def data_sets() -> dict[str, xr.DataArray]:
    """Return the data sets that come with spm1d, one a channel: strides of conditions a and b."""
    folder = Path(spm1d().__file__).parent / "data" / "datafiles"

    def of(name: str) -> Mapping[str, np.ndarray]:
        with np.load(folder / name) as stored:
            return {key: stored[key] for key in stored.files}

    knee = of("Besier2009kneeflexion.npz")
    sets = {"Besier2009 knee flexion, controls less patients": _groups(
        *(knee["Y"][knee["GROUP"] == group] for group in (0, 1))
    )}  # fmt: skip
    forces = of("Besier2009muscleforces.npz")
    for number in range(forces["YA"].shape[2]):
        name = f"Besier2009 muscle force {number + 1}, controls less patients"
        sets[name] = _groups(forces["YA"][..., number], forces["YB"][..., number])
    runs = of("Dorn2012.npz")
    foot, fast = runs["FOOT"] == 0, runs["SPEED"] > 6.0
    for number, axis in enumerate("xyz"):
        both = (runs["Y"][foot & one][..., number] for one in (fast, ~fast))
        sets[f"Dorn2012 ground reaction {axis}, 7 and 9.5 m/s less 3.6 and 5.2 m/s"] = _groups(
            *both
        )
    for name, file, axes, what in (
        ("Neptune1999 knee", "Neptune1999kneekin.npz", ("1", "2", "3"), "first less second task"),
        ("Pataky2014 centre of pressure", "Pataky2014cop.npz", ("x", "y"), "first less second"),
    ):
        pairs = of(file)
        for number, axis in enumerate(axes):
            both = (pairs[side][..., number] for side in ("YA", "YB"))
            sets[f"{name} {axis}, {what}"] = _pairs(*both)
    arch = np.load(folder / "ex_kinematics.npy")
    sets["Caravaggi2010 plantar arch, second less third speed"] = _pairs(arch[10:20], arch[20:])
    sets["Pataky2008 vertical force, fast less slow strides"] = _speeds(folder)
    return sets


def _groups(a: np.ndarray, b: np.ndarray) -> xr.DataArray:
    return _labelled(np.concatenate([a, b]), np.arange(len(a) + len(b)), len(a))


def _pairs(a: np.ndarray, b: np.ndarray) -> xr.DataArray:
    return _labelled(np.concatenate([a, b]), np.tile(np.arange(len(a)), 2), len(a))


def _labelled(values: np.ndarray, person: np.ndarray, first: int) -> xr.DataArray:
    condition = ["a"] * first + ["b"] * (len(values) - first)
    return read_curves(values, labels={"subject": list(person), "condition": condition})


def _speeds(folder: Path) -> xr.DataArray:
    """Return 60 strides of ten people, at three speeds, the slow ones as b and the fast as a."""
    speeds = np.load(folder / "ex_grf_speeds_cond.npy")
    strides = [np.load(folder / f"ex_grf_subj{n:03d}.npy") for n in range(speeds.shape[1])]
    condition = [{1: "b", 2: "normal", 3: "a"}[int(speed)] for speed in speeds.T.ravel()]
    person = np.repeat(np.arange(len(strides)), [len(one) for one in strides])
    return read_curves(
        np.concatenate(strides), labels={"subject": list(person), "condition": condition}
    )


class SubjectMeans:
    """A two-tailed t test of spm1d at 5 %, on the mean curve of every person's strides."""

    def __init__(self, curves: xr.DataArray) -> None:
        people = design_of(curves, A, B, "subject", (), False).people
        value, group, stats = people.value, people.group, spm1d().stats
        self._of = value, group
        field = stats.ttest2(*_sides(value, group)) if group.any() else stats.ttest(value)
        self.t: Float[np.ndarray, " t"] = np.asarray(field.z)
        self.error = np.abs(self._difference() / self.t)
        self.threshold = float(field.inference(0.05, two_tailed=True).zstar)

    def _difference(self) -> Float[np.ndarray, " t"]:
        value, group = self._of
        if not group.any():
            return value.mean(axis=0)
        one, other = (side.mean(axis=0) for side in _sides(value, group))
        return one - other

    def significant(self, hypothesis: Float[np.ndarray, " t"] | float = 0.0) -> np.ndarray:
        """Return where the difference is significantly another one (T,).

        Neither the standard error nor the threshold depend on it.
        """
        return np.abs(self._difference() - hypothesis) / self.error > self.threshold


def _sides(value: np.ndarray, group: np.ndarray) -> list[np.ndarray]:
    return [value[group == side] for side in (0, 1)]
