"""Low-dimensional motion: a clip in the space of the first components of its keyposes.

Perera, Kudoh and Ikeuchi, section 4. Poses are the features of
`bayesmotion.motion.features` (exponential maps and angles), so that what comes out is a
motion of the same skeleton; the root keeps its path.
"""

import numpy as np
import xarray as xr
from jaxtyping import Int

from ..models.keypose_pca import components
from ..motion.dataset import skeleton_of
from ..motion.features import decode, encode, layout_of
from ..motion.joining import split
from ..motion.skeleton import Skeleton


def low_dimensional(motion: xr.Dataset, keyposes: Int[np.ndarray, " k"], size: int) -> xr.Dataset:
    """Give a clip in the space of the first `size` components of its keyposes.

    Parameters
    ----------
    motion
        One clip with joint angles.
    keyposes
        Frames of its keyposes, at least two.
    size
        Dimensions, at most one less than there are keyposes.

    Raises
    ------
    InputError
        If there are too few keyposes for so many dimensions.
    """
    (clip,) = split(motion)
    skeleton: Skeleton = skeleton_of(motion)
    layout = layout_of(skeleton, leave_out=())
    features = encode(motion, layout)
    poses = features[:, : layout.n_angles]
    low = components(poses[keyposes]).low_dimensional(poses, size)
    angle = motion["angle"]
    return decode(
        np.concatenate([low, features[:, layout.n_angles :]], axis=1),
        layout,
        skeleton,
        frame_rate=float(motion.attrs["frame_rate"]),
        clip=clip,
        start=motion["root_position"].values[0],
        rest={str(dof): float(angle.sel(dof=dof).values[0]) for dof in angle["dof"].values},
        source=f"{size} dimensions of {clip}",
    )
