"""Keyposes of synthetic dances, where the truth is known (the paper's Figures 4 and 5).

Thresholds are learned from some dances with a little noise and drift; precision and recall
are measured on others, over noise, over drift, and over T_1 and T_2 around the learned ones.
The keypose model is fitted to the same dances, by NUTS and by an ensemble.
"""

import json
from typing import Any

import arviz as az
import numpy as np

from ...fit import Fit
from ...inference.predicting import predict
from ...inference.sampling.ensemble import fit_ensemble
from ...inference.sampling.nuts import fit_nuts
from ...models.keyposes import Keyposes
from ...models.keyposes.data import with_beats, with_keyposes
from ...models.keyposes.energy import Minima, Thresholds, minima_near
from ...models.keyposes.flows import flows_of
from ...models.keyposes.program import SITES
from ...models.keyposes.rule import NEVER, learn_both, score, select
from ...motion.joining import concat
from ...motion.synthetic.dance import Dance, synthetic_dance

LEARNED_FROM = range(100, 106)
MEASURED_ON = range(6)
LEARNING = {"noise": 0.02, "drift": 0.03}
NOISES = (0.0, 0.02, 0.05, 0.1, 0.2)
DRIFTS = (0.0, 0.03, 0.06, 0.1, 0.15)
SCALES = (0.0, 0.1, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 4.0, 8.0)
TOLERANCE = 6  # frames, a tenth of a second as in the model
CHAINS, DRAWS, WARMUP = 4, 1000, 500
WALKERS, STEPS, BURN_IN = 32, 4000, 1000

Case = tuple[Dance, Minima, Minima]


def case(seed: int, *, noise: float = 0.0, drift: float = 0.0) -> Case:
    """Make a dance and find the minima near its beats in both frames of reference."""
    dance = synthetic_dance(seed, noise=noise, drift=drift)
    rate = float(dance.motion.attrs["frame_rate"])
    window = 0.5 * float(np.median(np.diff(dance.beats))) * rate
    near = [minima_near(part, dance.beats * rate, window) for part in flows_of(dance.motion)]
    return dance, near[0], near[1]


def measure(cases: list[Case], thresholds: tuple[Thresholds, Thresholds]) -> dict[str, float]:
    """Give mean precision and recall of dances."""
    pairs = [
        score(select(g, b, thresholds).frame, dance.keyposes, TOLERANCE) for dance, g, b in cases
    ]
    precision, recall = np.mean(pairs, axis=0)
    return {"precision": float(precision), "recall": float(recall)}


def global_only(cases: list[Case], thresholds: Thresholds) -> dict[str, float]:
    """Give the same for the global frame alone, as the paper's Figures 4 and 5 do."""
    return measure(cases, (thresholds, NEVER))


def generative(dances: list[Dance], seed: int) -> tuple[dict[str, Any], Fit]:
    """Fit the keypose model by NUTS and by an ensemble, and compare them."""
    motion = concat(
        [with_keyposes(with_beats(d.motion, d.beats), d.keyposes.tolist()) for d in dances]
    )
    model = Keyposes()
    nuts = fit_nuts(model, motion, warmup=WARMUP, draws=DRAWS, chains=CHAINS, seed=seed)
    ensemble = fit_ensemble(
        model, motion, warmup=BURN_IN, steps=STEPS, draws=STEPS, walkers=WALKERS, seed=seed
    )
    worth = json.loads(ensemble.tree.attrs["ess"])
    rows: dict[str, Any] = {}
    gaps = []
    for name in SITES:
        pair = [fit.tree["posterior"].ds[name] for fit in (nuts, ensemble)]
        rows[name] = {
            "nuts": [float(pair[0].mean()), float(pair[0].std())],
            "emcee": [float(pair[1].mean()), float(pair[1].std())],
        }
        sizes = float(az.ess(pair[0])), min(worth[name], pair[1].size)
        error = np.sqrt(sum(float(p.var()) / n for p, n in zip(pair, sizes, strict=True)))
        gaps.append(abs(float(pair[0].mean() - pair[1].mean())) / error)
    rows["worst_difference_in_mcse"] = float(max(gaps))
    p = [predict(fit, motion, draws=STEPS).site().means()[:, 0] for fit in (nuts, ensemble)]
    answer = nuts.training.observed()["keypose"].values[:, 0]
    rows["largest_difference_of_probabilities"] = float(np.abs(p[0] - p[1]).max())
    rows["log_score"] = float(np.mean(np.log(np.where(answer > 0, p[0], 1.0 - p[0]))))
    rows["log_score_of_the_share"] = _constant_score(answer)
    return rows, nuts


def synthetic_plan() -> dict[str, Any]:
    """The settings of this part of the study."""
    return {
        "seeds": [list(LEARNED_FROM), list(MEASURED_ON)],
        "learning": LEARNING,
        "noises": list(NOISES),
        "drifts": list(DRIFTS),
        "scales": list(SCALES),
        "tolerance": TOLERANCE,
        "nuts": [CHAINS, DRAWS, WARMUP],
        "ensemble": [WALKERS, STEPS, BURN_IN],
    }


def run(seed: int) -> dict[str, Any]:
    """Give precision and recall over noise, drift and thresholds."""
    training = [case(s, **LEARNING) for s in LEARNED_FROM]
    thresholds = learn_both([(g, b, dance.keyposes) for dance, g, b in training], TOLERANCE)
    clean = [case(s) for s in MEASURED_ON]
    result: dict[str, Any] = {
        "thresholds": [
            [t.low, t.deep] if t != NEVER else None for t in thresholds
        ],
        "clean": measure(clean, thresholds),
        "noise": [{"noise": n} | measure([case(s, noise=n) for s in MEASURED_ON], thresholds)
                  for n in NOISES],
        "drift": [{"drift": d} | measure([case(s, drift=d) for s in MEASURED_ON], thresholds)
                  for d in DRIFTS],
    }  # fmt: skip
    usual = [case(s, **LEARNING) for s in MEASURED_ON]
    low, deep = thresholds[0].low, thresholds[0].deep
    result["T1"] = [
        {"T1": low * f} | global_only(usual, Thresholds(low * f, np.inf)) for f in SCALES
    ]
    result["T2"] = [
        {"T2": deep * f} | global_only(usual, Thresholds(-1.0, deep * f)) for f in SCALES
    ]
    hard = [synthetic_dance(s, noise=0.1, drift=0.06) for s in LEARNED_FROM]
    result["generative"], _ = generative(hard, seed)
    return result


def _constant_score(answer: np.ndarray) -> float:
    share = float(np.clip(answer.mean(), 1e-9, 1.0 - 1e-9))
    return float(np.mean(np.log(np.where(answer > 0, share, 1.0 - share))))
