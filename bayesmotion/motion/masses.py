"""Masses of a body's segments from a published table, put on the joints of a skeleton.

Fractions of the body's mass, and where a segment's centre of mass lies between its ends,
after Dempster as given by Winter (2009), Biomechanics and Motor Control of Human Movement,
4th edition, table 4.1. A segment's mass is shared by its two ends so that their mean lies
at its centre of mass; the velocity of the body's centre is then the weighted sum of the
joints' velocities.
"""

import numpy as np
from jaxtyping import Float

from .roles import SIDES, joint_roles, required_joints
from .skeleton import Skeleton

# Roles of upper and lower end (of the limbs on either side), mass, centre from the upper end.
_Segment = tuple[str, str, float, float]
_LIMBS: tuple[_Segment, ...] = (
    ("shoulder", "elbow", 0.028, 0.436),
    ("elbow", "wrist", 0.016, 0.430),
    ("wrist", "fingers", 0.006, 0.506),
    ("hip", "knee", 0.100, 0.433),
    ("knee", "ankle", 0.0465, 0.433),
    ("ankle", "toes", 0.0145, 0.500),
)
# The head's centre of mass lies at the ear, which the joint of the head is nearest to.
_MIDDLE: tuple[_Segment, ...] = (
    ("pelvis", "neck", 0.497, 0.500),
    ("neck", "head", 0.081, 1.000),
)


def joint_masses(skeleton: Skeleton) -> Float[np.ndarray, " j"]:
    """Give every joint its share of the body's mass; they sum to one.

    Parameters
    ----------
    skeleton
        Whose joints are known (`roles.joint_roles`). Where a hand or a foot has no end, its mass
        is at the wrist or the ankle.

    Raises
    ------
    InputError
        If another end of a segment is not found.
    """
    mass = np.zeros(len(skeleton))
    segments = [*_MIDDLE]
    for side in SIDES:
        segments += [(f"{side} {a}", f"{side} {b}", m, c) for a, b, m, c in _LIMBS]
    uppers = [upper for upper, *_ in segments]
    place = joint_roles(skeleton) | required_joints(skeleton, (*uppers, "head"))
    for upper, lower, share, centre in segments:
        mass[skeleton.index(place[upper])] += share * (1.0 - centre)
        mass[skeleton.index(place.get(lower, place[upper]))] += share * centre
    return mass / mass.sum()
