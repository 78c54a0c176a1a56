"""Small versions of the models, for checks that fit them hundreds of times.

Three clips of eight frames and three features: one person in two gaits, another in
one of them, a frame rate at which a clip takes a second. That is about one cycle, so
that the data can tell the steps and phases, and the posterior has one region that
matters for nearly all data the prior gives.
"""

import numpy as np

from ..models.multifactor import Dynamics, Factor, Multifactor, Noise
from ..models.poses import Frames, frames_of

FRAMES, FEATURES = 8, 3
LABELS = {
    "subject": {"ann-walk": "ann", "ann-run": "ann", "ben-walk": "ben"},
    "gait": {"ann-walk": "walk", "ann-run": "run", "ben-walk": "walk"},
}
LEVELS = {"subject": ["ann", "ben"], "gait": ["walk", "run"]}


def small_multifactor(
    dynamics: Dynamics = "circle", noise: Noise = "drift", factors: tuple[str, ...] = tuple(LEVELS)
) -> Multifactor:
    """Give the multifactor model with style vectors of two numbers."""
    sized = tuple(Factor(name, size=2) for name in factors)
    return Multifactor(dynamics, sized, content_size=2, noise=noise, frame_rate=float(FRAMES))


def small_frames(
    clips: tuple[str, ...] = tuple(LABELS["subject"]), factors: tuple[str, ...] = tuple(LEVELS)
) -> Frames:
    """Give the frames of the small data set, with zeros for poses."""
    parts = {clip: np.zeros((FRAMES, FEATURES)) for clip in clips}
    return frames_of(parts, LABELS, {factor: LEVELS[factor] for factor in factors})
