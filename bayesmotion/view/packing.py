"""Series of numbers packed for a page: whole numbers, their changes in time, deflated, base64.

Bodies move smoothly, so the changes from frame to frame are small numbers, of which most have an
upper byte of zero. Values x (S, N, K) of S series are sent as

    q = round(x / quantum),   d_n = q_n - q_{n-1} modulo 2^16,   z = zigzag(d)

series by series and column by column, first all lower bytes of z and then all upper ones.
`static/unpack.js` undoes it. What is not known (NaN) is the number `UNKNOWN`.
"""

import zlib
from base64 import b64encode

import numpy as np
from jaxtyping import Float, Int

# The least 16-bit number stands for what is not known.
UNKNOWN = -32768
LARGEST = 32767
QUANTUM = 0.0005  # metres: nobody sees half a millimetre


def quantum_for(*values: Float[np.ndarray, "..."]) -> float:
    """Return the step of the whole numbers that hold these values, at least `QUANTUM`.

    Examples
    --------
    >>> import numpy as np
    >>> from bayesmotion.view.packing import quantum_for
    >>> quantum_for(np.array([1.0, -2.0]))
    0.0005
    """
    reach = max(float(np.max(np.abs(v), initial=0.0, where=np.isfinite(v))) for v in values)
    return max(QUANTUM, reach / LARGEST)


def whole(values: Float[np.ndarray, "*n"], quantum: float) -> Int[np.ndarray, "*n"]:
    """Return values as whole numbers of steps, `UNKNOWN` where they are not finite.

    Parameters
    ----------
    values
        Of any shape.
    quantum
        The step, in the unit of the values.
    """
    known = np.isfinite(values)
    steps = np.rint(np.where(known, values, 0.0) / quantum)
    return np.where(known, np.clip(steps, -LARGEST, LARGEST), UNKNOWN).astype(np.int32)


def packed(numbers: Int[np.ndarray, "s n k"]) -> str:
    """Return whole numbers of 16 bits as text, to be unpacked on a page.

    Parameters
    ----------
    numbers
        Series (S) of frames (N) of columns (K).
    """
    along = np.moveaxis(numbers, 1, 2)
    change = np.diff(along, axis=2, prepend=0).astype(np.int16)
    zigzag = ((change << 1) ^ (change >> 15)).astype(np.uint16).ravel()
    planes = np.concatenate([zigzag & 0xFF, zigzag >> 8]).astype(np.uint8)
    return b64encode(zlib.compress(planes.tobytes(), 7)).decode("ascii")
