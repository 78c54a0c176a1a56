"""Synthetic walkers: people times gaits with known factors, for demonstrations and tests.

The model is the multilinear one that multifactor models are after (Wang, Fleet and
Hertzmann 2007). Person p has a style vector s_p in R^3, gait q a vector g_q in R^3;
the angles are Fourier series of the gait phase, whose coefficients and whose step are
bilinear in the two:

    angle_d(t) = sum_ij s_i g_j W[i, j, d] . basis(phase(t)) + noise
    phase(t)   = phase_0 + step t,    step = 2 pi (s^T C g) / frame_rate

`styles` says in how many independent directions people differ. A cell of the grid
that is left out is determined by the others when at least ``styles + 1`` other
people were recorded in that gait and the person in at least one other gait: then s_p
is a combination of the others' vectors, and so is every motion of p. With the three
people and the single direction of the default, one missing cell is determined.

The root's path is not part of the bilinear model: it follows from the angles and the
body, so that the feet stay on the floor (see `floor`).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...errors import InputError
from ..dataset import make_motion
from ..joining import concat, split
from ..quality.floor import root_path
from . import gaits as tables
from .anthropometry import adult_skeleton
from .walker_grid import Grid

SUBJECTS = ("ann", "ben", "cas")


@dataclass(frozen=True)
class Truth:
    """What synthetic walkers were made from.

    Parameters
    ----------
    grid
        The settings.
    subject_vector
        (subject, style): s; the first entry is 1.
    gait_vector
        (gait, mode): g; the first entry is 1.
    core
        (style, mode, dof, term): W in radians.
    step
        (subject, gait): radians of phase a frame.
    stature
        (subject,): metres.
    phase
        (frame,): gait phase in radians, not wrapped, frame by frame of `motion`; 0 is
        a heel strike of the left foot.
    motion
        Motion of every cell of the grid without noise, also of those left out.
    """

    grid: Grid
    subject_vector: xr.DataArray
    gait_vector: xr.DataArray
    core: xr.DataArray
    step: xr.DataArray
    stature: xr.DataArray
    phase: xr.DataArray
    motion: xr.Dataset

    @property
    def coefficient(self) -> xr.DataArray:
        """Fourier coefficients (subject, gait, dof, term) in radians."""
        return xr.dot(self.subject_vector, self.gait_vector, self.core, dim=("style", "mode"))

    def cell(self, subject: str, gait: str) -> xr.Dataset:
        """Give the noise-free Motion of one person in one gait, recorded or left out.

        Raises
        ------
        InputError
            If the grid has no such cell.
        """
        return split(self.motion)[self.grid.clip(subject, gait)]


def synthetic_walkers(
    subjects: Sequence[str] = SUBJECTS,
    gaits: Sequence[str] = tables.BASIC,
    *,
    leave_out: Iterable[tuple[str, str]] = (),
    seconds: float = 4.0,
    frame_rate: float = 30.0,
    noise: float = 0.01,
    styles: int = 1,
    seed: int = 0,
) -> xr.Dataset:
    """Make a Motion of people walking, running and striding, one clip a cell of the grid.

    Parameters
    ----------
    subjects
        Names of the people; each has a body (metres) and a style of its own.
    gaits
        Any of walk, run, stride, jog, stroll.
    leave_out
        Cells (subject, gait) that are not to be recorded.
    seconds
        Length of every clip.
    frame_rate
        Frames a second.
    noise
        Standard deviation in radians of the independent noise on every angle; the
        root's position is exact.
    styles
        1 or 2: in how many independent directions people differ.
    seed
        The same seed gives the same motion, and the cells that are recorded do not
        depend on which are left out.

    Returns
    -------
    Motion with the labels subject and gait and clips called ``ann-walk``. What it was
    made from is told by `synthetic_truth` with the same settings.

    Raises
    ------
    InputError
        If a setting cannot be used.
    """
    grid = Grid(subjects, gaits, seconds, frame_rate, styles, seed)
    kept = grid.clips_but(leave_out)
    if not (np.isfinite(noise) and noise >= 0):
        raise InputError("noise", f"it is {noise}", "Give a standard deviation in radians")
    exact = split(_truth(grid).motion)
    return concat([_with_noise(exact[clip], noise, grid.random("noise", clip)) for clip in kept])


def synthetic_truth(
    subjects: Sequence[str] = SUBJECTS,
    gaits: Sequence[str] = tables.BASIC,
    *,
    seconds: float = 4.0,
    frame_rate: float = 30.0,
    styles: int = 1,
    seed: int = 0,
) -> Truth:
    """Tell what `synthetic_walkers` with the same settings is made from.

    Parameters
    ----------
    subjects, gaits, seconds, frame_rate, styles, seed
        As in `synthetic_walkers`.

    Raises
    ------
    InputError
        If a setting cannot be used.
    """
    return _truth(Grid(subjects, gaits, seconds, frame_rate, styles, seed))


def _truth(grid: Grid) -> Truth:
    """Draw the factors and make every cell of the grid from them."""
    dofs = adult_skeleton("any", 1.75).dofs
    labels = {
        "subject": list(grid.subjects),
        "gait": list(grid.gaits),
        "style": list(tables.STYLES),
        "mode": list(tables.MODES),
        "dof": list(dofs),
        "term": list(tables.TERMS),
    }

    def named(values: np.ndarray, *dims: str) -> xr.DataArray:
        return xr.DataArray(values, dims=dims, coords={dim: labels[dim] for dim in dims})

    vectors = named(grid.style_vectors(), "subject", "style")
    modes = named(np.array([tables.GAITS[gait] for gait in grid.gaits]), "gait", "mode")
    core = named(tables.core(dofs), "style", "mode", "dof", "term")
    cadence = xr.dot(vectors, modes, named(tables.cadence_core(), "style", "mode"))
    step = cadence * (2 * np.pi / grid.frame_rate)
    stature = named(grid.statures(), "subject")
    coefficient = xr.dot(vectors, modes, core)
    cells = []
    for subject in grid.subjects:
        for gait in grid.gaits:
            place = {"subject": subject, "gait": gait}
            phase = grid.first_phase(**place) + np.arange(grid.frames) * step.sel(place).item()
            body = stature.sel(subject=subject).item()
            table = coefficient.sel(place).transpose("dof", "term").values
            cells.append((phase, _cell(grid, place, body, table, phase)))
    motion = concat([one for _, one in cells])
    phases = xr.DataArray(
        np.concatenate([phase for phase, _ in cells]),
        dims=("frame",),
        coords={name: motion[name] for name in ("frame", "clip", "subject", "gait", "time")},
    )
    return Truth(grid, vectors, modes, core, step, stature, phases, motion)


def _cell(
    grid: Grid,
    place: dict[str, str],
    stature: float,
    coefficient: Float[np.ndarray, "dof term"],
    phase: Float[np.ndarray, " frame"],
) -> xr.Dataset:
    """Make one clip without noise; it starts at the origin and goes towards +z."""
    skeleton = adult_skeleton(place["subject"], stature)

    def pose(at: np.ndarray) -> np.ndarray:
        return tables.fourier_basis(at) @ coefficient.T

    path = root_path(skeleton, pose, tables.duty(place["gait"]), stature)
    return make_motion(
        skeleton,
        pose(phase),
        path(phase) - np.array([0.0, 0.0, path(phase[:1])[0, 2]]),
        frame_rate=grid.frame_rate,
        clip=grid.clip(**place),
        labels=place,
        source=f"synthetic walker, seed {grid.seed}",
        history="made by synthetic_truth",
    )


def _with_noise(motion: xr.Dataset, noise: float, random: np.random.Generator) -> xr.Dataset:
    """Add independent noise to the angles of a Motion."""
    angle = motion["angle"] + noise * random.standard_normal(motion["angle"].shape)
    history = f"made by synthetic_walkers with noise of {noise:g} rad"
    return motion.assign(angle=angle).assign_attrs(history=history)
