"""The defaults of the multifactor model, chosen by training people who are left out.

Each training subject's clips are forecast by a fit to the others, as new people are
(`posterior_new_people.leave_subjects_out`), with a residual of one size or of each clip's
own, with and without novel style dimensions, as a Gaussian and as a t process. The highest log
score chooses, of equal ones the smallest error. No test clip has a part in it.
"""

from functools import partial
from typing import Any

import xarray as xr

from ...fit import Fit
from ...inference.optimisation.map import fit_map
from ...models.multifactor import OU, Multifactor
from ..posterior.new_people import leave_subjects_out, no_larger

# Whether residuals are each clip's own.
PER_CLIP = (False, True)
NOVEL_DIMS = (0, 1)
STUDENT_DF = (None, 16.0)


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
    for per_clip in PER_CLIP:
        train = partial(_train, per_clip, max_steps, seed)
        found = leave_subjects_out(motion, train, NOVEL_DIMS, STUDENT_DF)
        rows += [
            {"per_clip": per_clip, "novel_dims": novel, "student_df": df}
            | found[str(novel)]["scores"][str(df)]
            for novel in NOVEL_DIMS
            for df in STUDENT_DF
        ]
    return {"tried": rows, "chosen": best(rows)}


def defaults_plan() -> dict[str, Any]:
    """The settings that are tried."""
    return {
        "per_clip": list(PER_CLIP),
        "novel_dims": list(NOVEL_DIMS),
        "student_df": list(STUDENT_DF),
    }


def best(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Give the row of the highest log score, of equal ones that of the smallest error."""
    return max(rows, key=lambda row: (row["log_score"], -row["error"]))


def _train(per_clip: bool, max_steps: int, seed: int, motion: xr.Dataset) -> Fit:
    model = Multifactor(residual=OU(per_clip=per_clip), unknown_draws=0, context_weight=1.0)
    model = no_larger(model, motion)
    return fit_map(model, motion, seed=seed, keep=1, max_steps=max_steps)
