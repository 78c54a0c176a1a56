"""Which way is up in a recording, whose files may have any axis as the vertical.

Heads stay above feet while bodies turn and limbs swing: the vertical is the axis along which
joints lie farthest apart in the mean over the frames. Up is where the head is, or what else lies
above the hips; where no name tells, the positive side.
"""

import re
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

# Bodies that crouch or lie may be longer across than high: y is believed until then.
CLEARLY = 1.5
ABOVE = re.compile("head|neck|chest|shoulder|clav|[lr]fhd|c7", re.IGNORECASE)
BELOW = re.compile("foot|toe|heel|ankle|knee|tibia|shin|[lr]ank", re.IGNORECASE)


def upright(where: Float[np.ndarray, "n j 3"], names: Sequence[str]) -> Float[np.ndarray, "3 3"]:
    """Return the turn of a recording's axes that makes y the vertical.

    Parameters
    ----------
    where
        Places of joints or markers, NaN where unknown.
    names
        What they are called.

    Examples
    --------
    >>> import numpy as np
    >>> from bayesmotion.view.upright import upright
    >>> stands = np.array([[[0.0, 0.0, 0.0], [0.1, 0.0, 1.7]]])
    >>> (upright(stands, ["foot", "head"]) @ [0.0, 0.0, 1.0]).tolist()
    [0.0, 1.0, 0.0]
    """
    seen = np.isfinite(where).all(axis=2)
    known = seen.any(axis=0)
    # About the middle of what is seen of each frame.
    count = np.maximum(seen.sum(axis=1), 1)[:, None]
    middle = np.where(seen[..., None], where, 0.0).sum(axis=1) / count
    away = np.where(seen[..., None], where - middle[:, None], 0.0)
    mean = away.sum(axis=0)[known] / seen.sum(axis=0)[known, None]
    extent = mean.std(axis=0)
    axis = int(extent.argmax())
    if extent[axis] < CLEARLY * extent[1]:
        axis = 1
    high, low = (
        [pattern.search(name) is not None for name in np.asarray(names)[known]]
        for pattern in (ABOVE, BELOW)
    )
    downwards = any(high) and any(low) and mean[high, axis].mean() < mean[low, axis].mean()
    up = np.zeros(3)
    up[axis] = -1.0 if downwards else 1.0
    return _turn(axis, up)


def _turn(axis: int, up: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Return the rotation by quarters that brings an axis to y."""
    if axis == 1:
        return np.diag([1.0, up[1], up[1]])
    other = np.eye(3)[2 - axis]
    # Rows are the new axes; the third makes them right-handed.
    return np.stack([other, up, np.cross(other, up)])
