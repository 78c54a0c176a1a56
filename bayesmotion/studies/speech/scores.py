"""How far made faces are from recorded ones, and whether one model is nearer than another."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy import stats

from ...intervals import NINETY
from .data import LIPS, TEST, TRAINING

Faces = Mapping[str, Float[np.ndarray, "_ d"]]


def scores(made: Faces, true: Faces, spread: Faces | None = None) -> dict[str, float]:
    """Score the faces of some utterances.

    Root mean squares in mm, over all coordinates and over the lips'; the mean over coordinates
    of their correlation over all frames; the lips' peak-to-peak motion over the truth's, added
    up over their coordinates, the mean over utterances; the share of coordinates in the 90 %
    intervals, where there are standard deviations.
    """
    found, truth = (np.concatenate([part[name] for name in true]) for part in (made, true))
    off = found - truth
    pairs = zip(found.T, truth.T, strict=True)
    peaks = [
        np.ptp(made[name][:, LIPS], axis=0).sum() / np.ptp(true[name][:, LIPS], axis=0).sum()
        for name in true
    ]
    result = {
        "rms_mm": float(np.sqrt(np.mean(off**2))),
        "lips_rms_mm": float(np.sqrt(np.mean(off[:, LIPS] ** 2))),
        "correlation": float(np.mean([np.corrcoef(a, b)[0, 1] for a, b in pairs])),
        "lips_peak_to_peak": float(np.mean(peaks)),
    }
    if spread is not None:
        wide = np.concatenate([spread[name] for name in true])
        result["coverage90"] = float(np.mean(np.abs(off) < NINETY * wide))
    return result


def summary(repeats: Sequence[Mapping[str, float]]) -> dict[str, list[float]]:
    """Give the mean and the standard deviation over repeats of every score."""
    found = {}
    for name in repeats[0]:
        values = np.array([one[name] for one in repeats])
        sd = float(values.std(ddof=1)) if len(values) > 1 else 0.0
        found[name] = [float(values.mean()), sd]
    return found


def paired(a: Sequence[float], b: Sequence[float]) -> dict[str, float | list[float]]:
    """Give the mean of a - b over repeats and its 95 % interval.

    Repeats draw from the same utterances and are not independent: of n differences with
    variance s^2 the mean has about s^2 (1 / n + tested / trained), the corrected resampled t
    of Nadeau and Bengio (2003). Of one repeat nothing is known, and there is no interval.
    """
    apart = np.array(a) - np.array(b)
    middle = float(apart.mean())
    if len(apart) < 2:
        return {"mean": middle}
    reach = stats.t.ppf(0.975, len(apart) - 1) * apart.std(ddof=1)
    reach *= np.sqrt(1.0 / len(apart) + TEST / TRAINING)
    return {"mean": middle, "interval95": [middle - float(reach), middle + float(reach)]}
