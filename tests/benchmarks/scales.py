"""Which samples better, scales integrated out or sampled with the rest?

Runs NUTS both ways on the six clips of the multifactor study (stylistic circle model)
and prints the effective draws a second of the worst quantity, the leapfrog steps of a
draw and the largest R-hat, over all sites that both have:

    python tests/benchmarks/scales.py FOLDER_THAT_HOLDS_CMU [WARMUP DRAWS CHAINS]
"""

import sys
from pathlib import Path

import arviz as az
import numpy as np

from bayesmotion import console
from bayesmotion.inference.nuts import fit_nuts
from bayesmotion.studies.multifactor import MODELS, training_motion

NOISE = ("beta", "drift", "drift_time")
SITES = ("gamma", "step", "phase_point", "shape_subject", "shape_gait", *NOISE)


def figures(motion, integrate: bool, warmup: int, draws: int, chains: int) -> list[object]:
    fit = fit_nuts(
        MODELS["cdm_style"], motion, warmup=warmup, draws=draws, chains=chains, integrate=integrate
    )
    posterior, stats = fit.tree["posterior"].ds, fit.tree["sample_stats"]
    shared = posterior[list(SITES)]
    ess = min(float(v.min()) for v in az.ess(shared).data_vars.values())
    scales = float(az.ess(posterior[["scale"]])["scale"].min())
    rhat = max(float(v.max()) for v in az.rhat(shared).data_vars.values())
    seconds = float(fit.tree.attrs["seconds"])
    return [
        "integrated out" if integrate else "sampled", seconds, ess, scales, ess / seconds,
        float(np.mean(stats["n_steps"])), rhat, int(stats["diverging"].sum()),
    ]  # fmt: skip


def main(folder: str, warmup: str = "300", draws: str = "300", chains: str = "2") -> None:
    motion = training_motion(Path(folder))
    counts = (int(warmup), int(draws), int(chains))
    console.table(
        f"scales, {chains} chains of {warmup} + {draws}",
        [
            "",
            "seconds",
            "least ESS",
            "of scales",
            "ESS a second",
            "leapfrogs",
            "R-hat",
            "diverging",
        ],
        [figures(motion, integrate, *counts) for integrate in (True, False)],
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
