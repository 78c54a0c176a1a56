"""The boards of Hegde et al. (2022): the first pose of a clip given, the rest predicted.

CMU's subjects 09 (runs of 120 frames), 35 and 39 (walks of 300), each with few training, validation
and test clips of its own, 50 channels in degrees at 120 frames a second. Told are the squared
error of the forecast's mean and the log density, in the mean over entries.

The model and the choice of its settings are those of `studies.cmu35`, by subject: training and
validation clips are left out in folds, and no test clip has a part in any choice.
"""

from functools import partial
from pathlib import Path
from typing import Any

from ..boards.data import GPODE_SUBJECTS, read_gpode
from ..boards.multifactor import View, left_out
from ..boards.scoring import SIMPLE, baseline, choose, of_model, scored
from ..stages import Say, Stages

SIZES = (3,)
VIEWS = {
    "contexts count 1": View(),
    "contexts count 0.3": View(context_weight=0.3),
    "contexts count 0.1": View(context_weight=0.1),
}
FOLDS, MAX_STEPS = 3, 300
# Mean squared errors that others published, by subject in the order of `GPODE_SUBJECTS`.
PUBLISHED = {
    "GP-ODE, shooting": ((9.11, 10.11, 26.72), "Hegde et al. 2022"),
    "ODEON": ((7.5, 6.9, 15.6), "2026"),
}


def reproduce(data: Path | None, out: Path, say: Say = print, seed: int = 0) -> dict[str, Any]:
    """Choose on training clips left out, forecast the test clips, write ``gpode.json``.

    Parameters
    ----------
    data
        Folder that holds ``benchmarks/gpode``; where None ``$BAYESMOTION_DATA``.
    out
        Folder for the results.
    say
        Called with a line after every stage.
    seed
        Of the initial values, and of draws.
    """
    stages = Stages(out / "gpode.json", plan(seed), say)
    boards = {subject: read_gpode(subject, data) for subject in GPODE_SUBJECTS}
    for subject, board in boards.items():
        for part in (board.train, board.test):
            stages.read(**{f"{subject} {name}": clip for name, clip in part.items()})
        for name in SIMPLE:
            work = partial(scored, board, lambda b=board, n=name: baseline(b, n))
            stages.do("test", subject, name, work=work)
    for subject, board in boards.items():
        for size in SIZES:
            work = partial(left_out, board, size, VIEWS, folds=FOLDS, max_steps=MAX_STEPS,
                           seed=seed, say=say)  # fmt: skip
            stages.do("left_out", subject, str(size), work=work)
        found = stages.result["left_out"][subject]
        chosen = stages.do("chosen", subject, work=partial(choose, found))
        stages.do("test", subject, "multifactor",
                  work=partial(of_model, board, chosen, VIEWS, MAX_STEPS, seed))  # fmt: skip
    return stages.result


def plan(seed: int = 0) -> dict[str, Any]:
    """The settings of the study."""
    return {
        "sizes": list(SIZES),
        "views": {name: view._asdict() for name, view in VIEWS.items()},
        "folds": FOLDS,
        "max_steps": MAX_STEPS,
        "context": 1,
        "axes": "residual",
        "seed": seed,
    }
