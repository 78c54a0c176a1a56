"""Left and right by the names of joints, whoever named them.

``LeftUpLeg``, ``mixamorig:LeftArm``, ``L_Hip``, ``lfemur``, ``hip_l``, ``Hip.L``,
``Bip01 L Thigh`` and ``thighL`` are left. A name tells a side only where the same name of the
other side is there too: ``lowerback`` is not left, since there is no ``rowerback``.
"""

import re
from collections.abc import Sequence
from typing import Literal

Side = Literal["left", "right", "centre"]
_WORDS = {"left": "right", "right": "left", "l": "r", "r": "l"}
# What may tell a side: the word, the letter by itself, before a name, or behind it.
_PLACES = (
    re.compile(r"left|right", re.IGNORECASE),
    re.compile(r"(?<![a-zA-Z])[lr](?![a-zA-Z])", re.IGNORECASE),
    re.compile(r"(?<![a-zA-Z])[lr](?=[a-zA-Z])", re.IGNORECASE),
    re.compile(r"(?<=[a-z])[LR](?![a-zA-Z])"),
)


def sides(names: Sequence[str]) -> tuple[Side, ...]:
    """Return the side of every joint.

    Parameters
    ----------
    names
        Of all joints of a body.

    Examples
    --------
    >>> from bayesmotion.motion.sides import sides
    >>> sides(["Hips", "L_Knee", "R_Knee"])
    ('centre', 'left', 'right')
    """
    known = {name.casefold() for name in names}
    return tuple(_side(name, known) for name in names)


def without_side(name: str) -> str:
    """Return what a joint is called whichever side it is on, in small letters and no signs."""
    for place in _PLACES:
        shorter, count = place.subn("", name, count=1)
        if count:
            name = shorter
            break
    return re.sub(r"[^a-z]", "", name.casefold())


def _side(name: str, known: set[str]) -> Side:
    for place in _PLACES:
        for found in place.finditer(name):
            word = found[0].casefold()
            other = name[: found.start()] + _WORDS[word] + name[found.end() :]
            if other.casefold() in known:
                return "left" if word in ("left", "l") else "right"
    return "centre"
