"""The defaults of the multifactor model, chosen by training people who are left out.

Each training subject's clips are forecast by a fit to the others, as new people are
(`posterior_new_people.leave_subjects_out`), with a residual of one size or of each clip's
own, with and without spare style entries, as a Gaussian and as a t process. The highest log
score chooses, of equal ones the smallest error. No test clip has a part in it.
"""

from functools import partial
from typing import Any

import xarray as xr

from ..fit import Fit
from ..inference.map import fit_map
from ..models.multifactor import Multifactor, Noise
from .posterior_new_people import leave_subjects_out, no_larger

NOISES: tuple[Noise, ...] = ("drift", "own_drift")
SPARES = (0, 1)
FREEDOMS = (None, 16.0)


def choose_defaults(motion: xr.Dataset, *, max_steps: int, seed: int) -> dict[str, Any]:
    """Score every combination of settings on the people left out, and choose.

    Parameters
    ----------
    motion
        The training clips.
    max_steps
        Of each fit.
    seed
        Of each fit.

    Returns
    -------
    ``tried``, a row for each combination with its settings and mean scores, and ``chosen``,
    the row of the highest log score.
    """
    rows = []
    for noise in NOISES:
        train = partial(_train, noise, max_steps, seed)
        found = leave_subjects_out(motion, train, SPARES, FREEDOMS)
        rows += [
            {"noise": noise, "spare": spare, "freedom": freedom}
            | found[str(spare)]["scores"][str(freedom)]
            for spare in SPARES
            for freedom in FREEDOMS
        ]
    return {"tried": rows, "chosen": best(rows)}


def best(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Give the row of the highest log score, of equal ones that of the smallest error."""
    return max(rows, key=lambda row: (row["log_score"], -row["error"]))


def _train(noise: Noise, max_steps: int, seed: int, motion: xr.Dataset) -> Fit:
    model = no_larger(Multifactor(noise=noise), motion)
    return fit_map(model, motion, seed=seed, keep=1, max_steps=max_steps)
