"""Arrays of channels made into motions, as boards package them, and back.

A board's clips are arrays (N, D) of angles in degrees without a skeleton. A channel becomes a
joint that turns about one axis, below a root that neither turns nor moves: its angle is the
channel in radians, and the features of a model of motions are the channels and their velocities.
"""

from collections.abc import Mapping

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...motion import Joint, Skeleton
from ...motion.dataset import make_motion
from ...motion.joining import concat

ROOT = Joint("root", -1, (0.0, 0.0, 0.0), channels=("rx", "ry", "rz"))


def channel_skeleton(count: int) -> Skeleton:
    """Return a skeleton of so many joints about one axis each, below a root that stays.

    Examples
    --------
    >>> from bayesmotion.studies.boards.channels import channel_skeleton
    >>> len(channel_skeleton(50).dofs)
    53
    """
    joints = [Joint(f"c{i:02d}", 0, (0.0, 1.0, 0.0), channels=("rx",)) for i in range(count)]
    return Skeleton("channels", (ROOT, *joints))


def channel_motion(
    clips: Mapping[str, Float[np.ndarray, "n d"]],
    frame_rate: float,
    labels: Mapping[str, Mapping[str, str]] | None = None,
) -> xr.Dataset:
    """Return clips of channels as one Motion.

    Parameters
    ----------
    clips
        Channels (N, D) in degrees of each clip.
    frame_rate
        Frames a second.
    labels
        Of each clip what is known of it.

    Examples
    --------
    >>> import numpy as np
    >>> from bayesmotion.studies.boards.channels import channel_motion
    >>> channel_motion({"one": np.zeros((4, 2))}, 30.0).sizes["dof"]
    5
    """
    skeleton = channel_skeleton(next(iter(clips.values())).shape[1])
    return concat(
        [
            make_motion(
                skeleton,
                np.concatenate([np.zeros((len(y), 3)), np.radians(y)], axis=1),
                np.zeros((len(y), 3)),
                frame_rate=frame_rate,
                clip=name,
                labels=(labels or {}).get(name),
            )
            for name, y in clips.items()
        ]
    )
