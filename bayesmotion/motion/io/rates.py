"""Frame rates as files tell them."""

import numpy as np

from ...errors import InputError

# A file tells a rate in rounded figures: 0.0083333 s are 120.0005 Hz.
ROUNDING = 1e-4
# Nothing records a body faster; slower than one frame a second is no motion.
SLOWEST, FASTEST = 1.0, 10_000.0


def nominal(rate: float) -> float:
    """Return the whole number that a rate is rounded from, else the rate (frames a second)."""
    whole = float(round(rate))
    return whole if abs(rate - whole) <= ROUNDING * rate else rate


def declared_rate(where: object, rate: float, told: str) -> float:
    """Return a rate that a file declares, if it can be one.

    Parameters
    ----------
    where
        File or line, for the message.
    rate
        Frames a second.
    told
        What the file says, in its own words.

    Raises
    ------
    InputError
        If no recording has so many or few frames a second.
    """
    if not (np.isfinite(rate) and SLOWEST - ROUNDING <= rate <= FASTEST):
        raise InputError(
            where,
            f"{told} is no frame rate of a motion",
            "Give the frames a second, in Python frame_rate=30, in a shell --frame-rate 30",
        )
    return rate
