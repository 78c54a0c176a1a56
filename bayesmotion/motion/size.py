"""How large a body is: the length that lengths of its motion are told in.

BVH files have no unit of length, and people are of different sizes. Models see lengths divided
by the length of the legs, which depends on neither the unit nor the rest pose (Hof 1996,
Scaling gait data to body size).
"""

from functools import lru_cache
from typing import Literal

import numpy as np

from .anatomy import limbs_of
from .roles import ancestors
from .skeleton import Skeleton

# Of legs of an adult of 1.75 m: thigh and shank, in metres (`synthetic.anthropometry`).
ADULT_LEG = 0.86
# What lengths are told in: those of each body, or the unit of its file.
Lengths = Literal["body", "file"]


@lru_cache(maxsize=64)
def body_size(skeleton: Skeleton) -> float:
    """Return the length of a skeleton's legs, from hip to ankle, in its unit.

    Parameters
    ----------
    skeleton
        The body. Where no joint is called as a knee (`anatomy`), half its longest chain of bones
        from the root on counts: legs are about as long.

    Returns
    -------
    The mean of the legs that are found; one where all joints are in one place.

    Examples
    --------
    >>> import bayesmotion as bm
    >>> from bayesmotion.motion.size import body_size
    >>> _, walks = bm.example("multifactor")
    >>> bodies = bm.motion.skeletons(walks).values()
    >>> [round(body_size(body), 2) for body in bodies]
    [0.88, 0.85]
    """
    bones = [float(np.linalg.norm(joint.offset)) for joint in skeleton]
    legs = [
        sum(bones[i] for i in ancestors(skeleton, limb.lower) if limb.upper < i)
        for (_, kind), limb in limbs_of(skeleton).items()
        if kind == "leg"
    ]
    if legs and (length := float(np.mean(legs))) > 0.0:
        return length
    far = [0.0] * len(skeleton)
    for index, joint in enumerate(skeleton):
        if joint.parent >= 0:
            far[index] = far[joint.parent] + bones[index]
    return 0.5 * max(far) or 1.0
