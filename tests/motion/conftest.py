"""A small body in ASF/AMC, with every kind of joint, and Motions made of it."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bayesmotion.motion import Skeleton, make_motion, read_asf

ASF = """\
# a leg and an arm
:version 1.10
:name VICON
:units
  mass 1.0
  length 0.45
  angle deg
:documentation
  two limbs, one of them forked
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
  begin
     id 1
     name hip
     direction 0.6 -0.8 0
     length 2.5
     axis 0 0 0 XYZ
  end
  begin
     id 2
     name femur
     direction 0.34202 -0.939693 0
     length 7.2
     axis 10 -15 20 XYZ
    dof rx ry rz
    limits (-160.0 20.0)
           (-70.0 70.0)
           (-60.0 70.0)
  end
  begin
     id 3
     name foot
     direction 0 -0.3 0.95
     length 2.2
     axis -90 0 20 XYZ
    dof rx rz
    limits (-45.0 90.0)
           (-70.0 20.0)
  end
  begin
     id 4
     name spine
     direction 0 1 0
     length 9
     axis 0 0 0 XYZ
    dof rx ry rz
  end
  begin
     id 5
     name larm
     direction 1 0 0
     length 5
     axis 180 -30 -90 XYZ
    dof ry rz
  end
  begin
     id 6
     name head
     direction 0 1 0
     length 2
     axis 0 0 0 XYZ
    dof rx ry rz
  end
:hierarchy
  begin
    root hip spine
    hip femur
    femur foot
    spine larm head
  end
"""


@pytest.fixture
def asf_text() -> str:
    return ASF


@pytest.fixture
def asf(tmp_path: Path) -> Path:
    path = tmp_path / "body.asf"
    path.write_text(ASF)
    return path


@pytest.fixture
def skeleton(asf: Path) -> Skeleton:
    return read_asf(asf)


@pytest.fixture
def make(skeleton: Skeleton):
    """Make smooth motions of the small body."""

    def make(
        clip: str = "walk", frames: int = 60, seed: int = 0, rate: float = 120.0, **labels: str
    ) -> xr.Dataset:
        random = np.random.default_rng(seed)
        time = np.arange(frames)[:, None] / 120.0
        phases = random.uniform(0.0, 2.0 * np.pi, (1, len(skeleton.dofs)))
        angle = 0.5 * np.sin(2.0 * np.pi * time + phases)
        root = np.hstack([0.1 * time, 17.0 + 0.2 * np.sin(9.0 * time), 20.0 * time])
        return make_motion(
            skeleton, angle, root, frame_rate=rate, clip=clip, labels=labels, source="made"
        )

    return make
