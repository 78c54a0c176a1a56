"""The skeleton: a tree of joints, one convention for ASF/AMC and BVH alike.

A joint is a centre of rotation. Its position is its parent's position plus
its offset turned by the parent's rotation; its own rotation turns everything
below it:

    p_j = p_parent + R_parent offset_j
    R_j = R_parent C_j E_j C_j^T

where E_j is the product of the elementary rotations named by `channels`, read
from left to right (``("rz", "ry", "rx")`` is Rz Ry Rx), and C_j = Rz Ry Rx of
the angles `axis` (the rest frame of an ASF bone; zero in BVH). A joint without
channels does not turn: leaf ends are such joints.

In an ASF file a bone starts where its parent bone ends, so bone ``lfemur``
becomes the joint ``lfemur`` at the hip, and the end of a leaf bone ``ltoes``
becomes the joint ``ltoes_end``.
"""

import json
import math
import operator
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property

from ..errors import InputError

CHANNELS = ("rx", "ry", "rz")


@dataclass(frozen=True)
class Joint:
    """One joint of a `Skeleton`.

    Parameters
    ----------
    name
        Unique in the skeleton.
    parent
        Index of the parent joint, -1 for the root.
    offset
        Position relative to the parent in the rest pose, in the skeleton's unit.
    axis
        Angles (x, y, z) in radians of the frame C = Rz Ry Rx the joint turns in.
    channels
        Elementary rotations in the order of the matrix product, left to right.
    """

    name: str
    parent: int
    offset: tuple[float, float, float]
    axis: tuple[float, float, float] = (0.0, 0.0, 0.0)
    channels: tuple[str, ...] = ()


@dataclass(frozen=True)
class Skeleton:
    """A tree of joints, parents before their children.

    Parameters
    ----------
    name
        What the skeleton is called (the subject, or the file's stem).
    joints
        The joints; the first is the root.
    metres
        Metres in one length unit, or None where the file does not say.
    roles
        Pairs of a role and the joint that has it, whatever its name tells
        (`roles.with_joints`).

    Raises
    ------
    InputError
        If a name stands twice, a parent comes after its child or a channel is unknown.
    """

    name: str
    joints: tuple[Joint, ...]
    metres: float | None = None
    roles: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        """Check the tree once, so that nobody downstream has to."""
        where = f"skeleton {self.name!r}"
        if not self.joints or self.joints[0].parent != -1:
            raise InputError(where, "the first joint is not a root", "Give the root first")
        seen: set[str] = set()
        for index, joint in enumerate(self.joints):
            if joint.name in seen:
                raise InputError(where, f"two joints are called {joint.name!r}", "Rename one")
            seen.add(joint.name)
            if index and not 0 <= joint.parent < index:
                raise InputError(
                    where,
                    f"the parent of {joint.name!r} does not come before it",
                    "Sort the joints",
                )
            if len(set(joint.channels)) != len(joint.channels) or not set(joint.channels) <= set(
                CHANNELS
            ):
                raise InputError(
                    where,
                    f"{joint.name!r} has the channels {joint.channels}",
                    "Use each of rx, ry, rz at most once",
                )

    def __iter__(self) -> Iterator[Joint]:
        """Iterate over the joints, parents first."""
        return iter(self.joints)

    def __len__(self) -> int:
        """Give the number of joints."""
        return len(self.joints)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def dofs(self) -> tuple[str, ...]:
        """Labels of the angular degrees of freedom, ``joint/channel``, joint by joint."""
        return tuple(f"{joint.name}/{channel}" for joint in self for channel in joint.channels)

    def index(self, name: str) -> int:
        """Give the index of the joint called `name`.

        Raises
        ------
        InputError
            If there is no such joint.
        """
        try:
            return self.names.index(name)
        except ValueError:
            raise InputError(
                f"skeleton {self.name!r}",
                f"there is no joint {name!r}",
                f"Use one of {', '.join(self.names)}",
            ) from None

    def to_json(self) -> str:
        """Write the skeleton as JSON text, exactly (floats come back the same)."""
        fields = asdict(self)
        if not self.roles:
            del fields["roles"]
        return json.dumps(fields)

    @classmethod
    def from_json(cls, text: str) -> "Skeleton":
        """Read back what `to_json` wrote.

        Raises
        ------
        InputError
            If the text is none of a skeleton.
        """
        try:
            fields = json.loads(text)
            joints = tuple(
                Joint(
                    name=str(joint["name"]),
                    parent=operator.index(joint["parent"]),
                    offset=_triple(joint["offset"]),
                    axis=_triple(joint["axis"]),
                    channels=tuple(map(str, joint["channels"])),
                )
                for joint in fields["joints"]
            )
            metres = None if fields["metres"] is None else float(fields["metres"])
            if metres is not None and not (math.isfinite(metres) and metres > 0):
                raise ValueError(f"its unit is {metres} metres")
            roles = tuple((str(role), str(joint)) for role, joint in fields.get("roles", ()))
            return cls(str(fields["name"]), joints, metres, roles)
        except InputError:
            raise
        except (ValueError, TypeError, LookupError, OverflowError, RecursionError) as error:
            raise InputError(
                "skeleton", f"its description is damaged ({error})", "Get the file again"
            ) from error


def _triple(numbers: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = map(float, numbers)
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        raise ValueError(f"{numbers} are not finite")
    return x, y, z
