"""Masses of a body's segments from a published table, put on the joints of a skeleton.

Fractions of the body's mass, and where a segment's centre of mass lies between its ends,
after Dempster as given by Winter (2009), Biomechanics and Motor Control of Human Movement,
4th edition, table 4.1. A segment's mass is shared by its two ends so that their mean lies
at its centre of mass; the velocity of the body's centre is then the weighted sum of the
joints' velocities.
"""

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .skeleton import Skeleton

# Upper end, lower end (the first joint that the skeleton has), mass, centre from the upper end.
_Segment = tuple[str, tuple[str, ...], float, float]
_SIDES: tuple[_Segment, ...] = (
    ("humerus", ("radius",), 0.028, 0.436),
    ("radius", ("wrist", "hand"), 0.016, 0.430),
    ("wrist", ("fingers", "hand", "wrist"), 0.006, 0.506),
    ("femur", ("tibia",), 0.100, 0.433),
    ("tibia", ("foot",), 0.0465, 0.433),
    ("foot", ("toes",), 0.0145, 0.500),
)
# The head's centre of mass lies at the ear, which the joint of the head is nearest to.
_MIDDLE: tuple[_Segment, ...] = (
    ("root", ("lowerneck",), 0.497, 0.500),
    ("lowerneck", ("head",), 0.081, 1.000),
)


def joint_masses(skeleton: Skeleton) -> Float[np.ndarray, " j"]:
    """Give every joint its share of the body's mass; they sum to one.

    Parameters
    ----------
    skeleton
        With the joint names of the CMU recordings and of HDM05 (lfemur, rradius, ...).

    Raises
    ------
    InputError
        If a segment's ends are not among the joints.
    """
    mass = np.zeros(len(skeleton))
    segments = [*_MIDDLE]
    for side in "lr":
        segments += [(side + a, tuple(side + b for b in ends), m, c) for a, ends, m, c in _SIDES]
    for upper, ends, share, centre in segments:
        lower = next((name for name in ends if name in skeleton.names), None)
        if upper not in skeleton.names or lower is None:
            raise InputError(
                f"skeleton {skeleton.name!r}",
                f"it has no joints {upper} and {' or '.join(ends)} for a segment's mass",
                "Use equal weights, or give every joint a weight",
            )
        mass[skeleton.index(upper)] += share * (1.0 - centre)
        mass[skeleton.index(lower)] += share * centre
    return mass / mass.sum()
