"""What a player shows: bodies that move, clouds of points, and sound, in metres and seconds.

A scene knows nothing of models or files: `tracks` makes its parts, `viewer` the page.
"""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from .packing import packed, quantum_for, whole

Role = Literal["truth", "mean", "motion"]
Arrangement = Literal["overlaid", "beside"]


@dataclass(frozen=True)
class Ghosts:
    """Draws of a motion, and how far they are from each other.

    where
        (S, N, J, 3): places of the joints in every draw, in metres.
    sd
        (N, J): root mean square distance of a joint from its mean, in metres; None where there
        are too few draws to tell.
    """

    where: Float[np.ndarray, "s n j 3"]
    sd: Float[np.ndarray, "n j"] | None


@dataclass(frozen=True)
class Track:
    """One body, or one set of markers, that moves.

    name
        What it is called.
    role
        ``truth``, the ``mean`` of a prediction, or any other ``motion``.
    where
        (N, J, 3): places of joints or markers in metres, y up from the floor; NaN where unknown.
    joints
        Their names.
    bones
        (B, 2): joints at the ends of every bone; none for markers.
    sides
        For each joint 0 for left, 1 for right, 2 for neither.
    head
        Joints at the base and the top of the head, None without.
    stature
        Height of the body in metres.
    rate
        Frames a second.
    context
        How many frames at the start a prediction was told; None where nothing was predicted.
    ghosts
        Draws of it, None without.
    """

    name: str
    role: Role
    where: Float[np.ndarray, "n j 3"]
    joints: tuple[str, ...]
    bones: Int[np.ndarray, "b 2"]
    sides: tuple[int, ...]
    head: tuple[int, int] | None
    stature: float
    rate: float
    context: int | None = None
    ghosts: Ghosts | None = None

    def content(self) -> dict[str, Any]:
        """Return what the page is told."""
        n, j, _ = self.where.shape
        drawn = self.ghosts
        quantum = quantum_for(self.where, *([drawn.where] if drawn else []))
        mean = whole(self.where, quantum)
        out: dict[str, Any] = {
            "name": self.name, "role": self.role, "joints": list(self.joints),
            "bones": self.bones.tolist(), "sides": list(self.sides), "head": self.head,
            "stature": self.stature, "rate": self.rate, "frames": n, "context": self.context,
            "quantum": quantum, "where": packed(mean.reshape(1, n, 3 * j)),
        }  # fmt: skip
        if drawn is not None:
            # Where all draws are the same, as in what was given, nothing is left to be sent.
            apart = whole(drawn.where, quantum) - mean
            out["ghosts"] = {
                "count": len(apart), "where": packed(apart.reshape(len(apart), n, 3 * j)),
            }  # fmt: skip
            if drawn.sd is not None:
                out["sd"] = packed(whole(drawn.sd, quantum)[None])
        return out


@dataclass(frozen=True)
class Cloud:
    """Points of which there are more or fewer from frame to frame, such as voxels.

    name
        What it is called.
    where
        (P, 3): the points of all frames one after the other, in metres.
    counts
        (N,): how many each frame has.
    size
        Of a point, in metres.
    rate
        Frames a second.
    """

    name: str
    where: Float[np.ndarray, "p 3"]
    counts: Int[np.ndarray, " n"]
    size: float
    rate: float

    def content(self) -> dict[str, Any]:
        """Return what the page is told."""
        quantum = quantum_for(self.where)
        return {
            "name": self.name, "counts": self.counts.tolist(), "size": self.size,
            "rate": self.rate, "frames": len(self.counts), "quantum": quantum,
            "points": len(self.where), "where": packed(whole(self.where, quantum)[None]),
        }  # fmt: skip


@dataclass(frozen=True)
class Sound:
    """A sound file, and the second of it at which the motions begin."""

    kind: str
    data: str
    start: float


@dataclass(frozen=True)
class Scene:
    """All that a page shows.

    title
        What stands above it.
    tracks, clouds
        What moves.
    arrangement
        All in one place, or one beside the other.
    sound
        What is heard, None without.
    messages
        What is to be known of it, in sentences.
    """

    title: str
    tracks: tuple[Track, ...]
    clouds: tuple[Cloud, ...] = ()
    arrangement: Arrangement = "overlaid"
    sound: Sound | None = None
    messages: tuple[str, ...] = field(default=())

    def content(self) -> dict[str, Any]:
        """Return what the page is told, as plain values."""
        sound = self.sound
        return {
            "title": self.title,
            "tracks": [track.content() for track in self.tracks],
            "clouds": [cloud.content() for cloud in self.clouds],
            "arrangement": self.arrangement,
            "sound": sound and {"kind": sound.kind, "data": sound.data, "start": sound.start},
            "messages": list(self.messages),
        }
