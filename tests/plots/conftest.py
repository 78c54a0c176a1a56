"""Short clips of synthetic people, and the same body with the names of BVH files."""

import re
from dataclasses import replace

import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from bayesmotion.motion import Skeleton, make_motion, skeleton_of, split
from bayesmotion.motion.synthetic.walkers import synthetic_walkers

_BVH = {"femur": "UpLeg", "tibia": "Leg", "humerus": "Arm", "radius": "ForeArm"}


@pytest.fixture(scope="session")
def walkers() -> dict[str, xr.Dataset]:
    return split(synthetic_walkers(("ann", "ben"), ("walk", "run"), seconds=1.0))


@pytest.fixture(scope="session")
def walk(walkers) -> xr.Dataset:
    return walkers["ann-walk"]


@pytest.fixture(scope="session")
def bvh_like(walk) -> xr.Dataset:
    """The walk of a body twice as large in an unknown unit, with BVH names."""
    body = skeleton_of(walk)
    joints = [
        replace(joint, name=_renamed(joint.name), offset=tuple(2.0 * x for x in joint.offset))
        for joint in body
    ]
    return make_motion(
        Skeleton("big", tuple(joints), metres=None),
        walk["angle"].values,
        2.0 * walk["root_position"].values,
        frame_rate=30.0,
        clip="big walk",
    )


@pytest.fixture
def turned(walk):
    """Turn the walk about the vertical, so that it goes another way."""

    def turned(angle: float) -> xr.Dataset:
        root = ["root/rz", "root/ry", "root/rx"]
        vertical = Rotation.from_rotvec([0.0, angle, 0.0])
        own = Rotation.from_euler("ZYX", walk["angle"].sel(dof=root).values)
        angles = walk["angle"].copy()
        angles.loc[{"dof": root}] = (vertical * own).as_euler("ZYX")
        path = vertical.apply(walk["root_position"].values)
        return walk.assign(angle=angles, root_position=(("frame", "space"), path))

    return turned


def _renamed(name: str) -> str:
    side = re.fullmatch(r"([lr])(hipjoint|femur|tibia|humerus|radius|hand)", name)
    if side is None:
        return name
    return {"l": "Left", "r": "Right"}[side[1]] + _BVH.get(side[2], side[2].capitalize())
