"""Keyposes of a motion at the beats of its music, by the paper's rule.

How sure they are is told by the model: fit `bayesmotion.models.keyposes.Keyposes` to motions
whose keyposes are known, and predict others.
"""

from dataclasses import replace

import numpy as np
import xarray as xr
from jaxtyping import Float

from ..errors import InputError
from ..models.keyposes.energy import Minima, Thresholds, minima_near
from ..models.keyposes.flows import flows_of
from ..models.keyposes.rule import KeyposeFrames, select


def keyposes_of(
    motion: xr.Dataset,
    beats: Float[np.ndarray, " b"],
    thresholds: tuple[Thresholds, Thresholds] | None = None,
    *,
    low: float | None = None,
    deep: float | None = None,
    window: float | None = None,
    weight: Float[np.ndarray, " j"] | None = None,
) -> tuple[KeyposeFrames, Minima, Minima]:
    """Return the keyposes of one clip by the paper's rule.

    Parameters
    ----------
    motion
        One clip with a skeleton.
    beats
        Times of the beats in seconds from the clip's first frame.
    thresholds
        For the global and the body's frame; by default `plain_thresholds` of each.
    low, deep
        T_1 and T_2 in both frames of reference instead, each by itself.
    window
        Seconds around a beat in which minima are looked for; by default half the median
        time between beats.
    weight
        Of every joint, equal by default; `bayesmotion.motion.masses.joint_masses` for masses.

    Returns
    -------
    The keyposes, and the minima near the beats in the global and in the body's frame.

    Raises
    ------
    InputError
        If no beat lies within the clip.
    """
    rate = float(motion.attrs["frame_rate"])
    inside = beats[(beats >= 0) & (beats * rate <= motion.sizes["frame"] - 1)]
    if not len(inside):
        raise InputError("beats", "none lies within the clip", "Give seconds from its first frame")
    if window is None:
        window = 0.5 * float(np.median(np.diff(inside))) if len(inside) > 1 else 0.25
    minima = [minima_near(part, inside * rate, window * rate) for part in flows_of(motion, weight)]
    if thresholds is None:
        thresholds = (plain_thresholds(minima[0]), plain_thresholds(minima[1]))
    given = {name: value for name, value in (("low", low), ("deep", deep)) if value is not None}
    thresholds = (replace(thresholds[0], **given), replace(thresholds[1], **given))
    return select(minima[0], minima[1], thresholds), minima[0], minima[1]


def plain_thresholds(minima: Minima) -> Thresholds:
    """Return thresholds where no examples are: the lower quartile of energies, the median depth."""
    there = minima.frame >= 0
    if not there.any():
        return Thresholds(0.0, np.inf)
    return Thresholds(
        float(np.quantile(minima.energy[there], 0.25)), float(np.median(minima.depth[there]))
    )
