"""An adult's skeleton from a published table of segment lengths.

Segment lengths are fractions of stature after Drillis and Contini (1966), Body
segment parameters, New York University, as given by Winter (2009),
Biomechanics and Motor Control of Human Movement, 4th edition, figure 4.1. Where the
table has no entry (the spine's parts, the hip centres, the split of a hand) the
numbers are round fractions that make the parts add up to the table's heights.

Joint names and degrees of freedom are those of the CMU recordings, so that features
and models written for these work unchanged. The rest pose stands upright with the
arms held out to the sides: y up, the face towards +z, +x to the figure's left.
"""

import math

from ..skeleton import Joint, Skeleton

# Fractions of stature.
ANKLE, SHANK, THIGH = 0.039, 0.246, 0.245  # heights add up to the hip at 0.530
FOOT = 0.152
UPPER_ARM, FOREARM, HAND = 0.186, 0.146, 0.108
SHOULDER = 0.129  # from the midline to the shoulder
SHOULDER_HEIGHT, CHIN_HEIGHT = 0.818, 0.870
HIP = 0.191 / 4  # from the midline to the hip's centre: a quarter of the hips' width
PELVIS = 0.045  # from the hips up to the root
CLAVICLE = 0.020  # from the end of the thorax up to the shoulder
HEEL, BALL = 0.25 * FOOT, 0.45 * FOOT  # behind and before the ankle
TOE_OUT = math.radians(6.0)
_ROOT_HEIGHT = ANKLE + SHANK + THIGH + PELVIS
_SPINE = (SHOULDER_HEIGHT - CLAVICLE - _ROOT_HEIGHT) / 3
_NECK = (CHIN_HEIGHT - SHOULDER_HEIGHT + CLAVICLE) / 2
_HEAD = 1.0 - CHIN_HEIGHT

_QUARTER = math.pi / 2
_ZERO = (0.0, 0.0, 0.0)
_XYZ = ("rz", "ry", "rx")
_Bone = tuple[str, str, tuple[float, float, float], tuple[float, float, float], tuple[str, ...]]

# Name, parent, offset from the parent in statures, axis, channels. One side only;
# the other is its mirror image. The axes make rx of an arm's joints the bending one:
# of humerus and radius forwards, of hand, fingers and thumb towards the palm.
_MIDDLE: tuple[_Bone, ...] = (
    ("lowerback", "root", _ZERO, _ZERO, _XYZ),
    ("upperback", "lowerback", (0.0, _SPINE, 0.0), _ZERO, _XYZ),
    ("thorax", "upperback", (0.0, _SPINE, 0.0), _ZERO, _XYZ),
    ("lowerneck", "thorax", (0.0, _SPINE, 0.0), _ZERO, _XYZ),
    ("upperneck", "lowerneck", (0.0, _NECK, 0.0), _ZERO, _XYZ),
    ("head", "upperneck", (0.0, _NECK, 0.0), _ZERO, _XYZ),
    ("head_end", "head", (0.0, _HEAD, 0.0), _ZERO, ()),
)
TOES = FOOT - HEEL - BALL
_OUT, _AHEAD = math.sin(TOE_OUT), math.cos(TOE_OUT)
LEG: tuple[_Bone, ...] = (
    ("hipjoint", "root", _ZERO, _ZERO, ()),
    ("femur", "hipjoint", (HIP, -PELVIS, 0.0), _ZERO, _XYZ),
    ("tibia", "femur", (0.0, -THIGH, 0.0), _ZERO, ("rx",)),
    ("foot", "tibia", (0.0, -SHANK, 0.0), _ZERO, ("rz", "rx")),
    ("toes", "foot", (_OUT * BALL, -ANKLE, _AHEAD * BALL), _ZERO, ("rx",)),
    ("toes_end", "toes", (_OUT * TOES, 0.0, _AHEAD * TOES), _ZERO, ()),
)
_ARM_AXIS = (0.0, 0.0, -_QUARTER)
_HAND_AXIS = (0.0, _QUARTER, _QUARTER)
_THUMB = 0.4 * HAND / math.sqrt(2)
_ARM: tuple[_Bone, ...] = (
    ("clavicle", "thorax", (0.0, _SPINE, 0.0), _ZERO, ("rz", "ry")),
    ("humerus", "clavicle", (SHOULDER, CLAVICLE, 0.0), _ARM_AXIS, _XYZ),
    ("radius", "humerus", (UPPER_ARM, 0.0, 0.0), _ARM_AXIS, ("rx",)),
    ("wrist", "radius", (FOREARM * 2 / 3, 0.0, 0.0), _HAND_AXIS, ("ry",)),
    ("hand", "wrist", (FOREARM / 3, 0.0, 0.0), _HAND_AXIS, ("rz", "rx")),
    ("fingers", "hand", (HAND / 2, 0.0, 0.0), _HAND_AXIS, ("rx",)),
    ("fingers_end", "fingers", (HAND / 2, 0.0, 0.0), _ZERO, ()),
    ("thumb", "wrist", (FOREARM / 3, 0.0, 0.0), (0.0, _QUARTER / 2, 0.0), ("rz", "rx")),
    ("thumb_end", "thumb", (_THUMB, 0.0, _THUMB), _ZERO, ()),
)


def adult_skeleton(name: str, stature: float) -> Skeleton:
    """Give the skeleton of an adult in metres, with the joints of the CMU recordings.

    Parameters
    ----------
    name
        Name of the skeleton.
    stature
        Height of the standing adult in metres.

    Returns
    -------
    A skeleton whose root is the pelvis, with 62 - 3 = 59 angular degrees of freedom
    (the CMU files count the root's translation among their 62).
    """
    bones = [
        *(_sided("l", bone) for bone in LEG),
        *(_sided("r", bone) for bone in LEG),
        *_MIDDLE,
        *(_sided("l", bone) for bone in _ARM),
        *(_sided("r", bone) for bone in _ARM),
    ]
    joints = [Joint("root", -1, _ZERO, _ZERO, _XYZ)]
    places = {"root": 0}
    for bone, parent, (x, y, z), axis, channels in bones:
        offset = (x * stature, y * stature, z * stature)
        places[bone] = len(joints)
        joints.append(Joint(bone, places[parent], offset, axis, channels))
    return Skeleton(name, tuple(joints), metres=1.0)


def _sided(side: str, bone: _Bone) -> _Bone:
    """Give a limb's bone its side; the right one is the left one mirrored in x."""
    name, parent, (x, y, z), (ax, ay, az), channels = bone
    shared = parent in ("root", "thorax")
    parent = parent if shared else side + parent
    if side == "r":
        # A rotation seen in a mirror across x keeps its rx and turns ry and rz round.
        return side + name, parent, (-x, y, z), (ax, -ay, -az), channels
    return side + name, parent, (x, y, z), (ax, ay, az), channels
