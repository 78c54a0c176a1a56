"""The walks of the gait-pose study: which trials, and their cycles on one body."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float

from ...models.gait_pose.encoding import CycleEncoding, learn_cycle_encoding
from ...motion import concat, split
from ...motion.cycles import cycles_of, diversified
from ..trials import read_trial

# Trial: cycles taken, the straightest ones. Of four people the BVH releases are at hand. The
# walks of subject 03 are over uneven ground; 09_12 walks about, once straight on.
TRAINING = {
    "02_01": 1, "02_02": 1, "05_01": 3, "09_12": 1, "12_02": 2, "12_03": 2, "49_01": 3,
    "06_01.bvh": 2, "10_04.bvh": 2, "32_01.bvh": 1, "32_02.bvh": 1, "131_01.bvh": 1,
}  # fmt: skip
TEST = {
    "07_01": 1, "07_02": 1, "07_06": 1, "07_07": 1, "07_10": 1, "08_01": 1, "08_03": 1,
    "08_10": 1, "16_14": 1, "16_15": 2, "16_16": 2, "16_21": 1, "16_22": 1, "35_01": 1,
    "35_02": 1, "35_04": 1, "35_06": 1, "35_11": 1,
}  # fmt: skip
STRIDES = {"07_11": 1, "08_05": 1}
TEST_SCALES = (0.4, 0.5, 0.667, 1.0, 1.25)


@dataclass(frozen=True)
class Walks:
    """The cycles of the study.

    training
        Recorded training cycles.
    test
        For every scale, and the strides, scaled features (C, T, D).
    encoding
        How they are scaled.
    """

    training: xr.Dataset
    test: dict[str, Float[np.ndarray, "c t d"]]
    encoding: CycleEncoding


def cut(trials: Mapping[str, int], data: Path | None) -> xr.Dataset:
    """Read trials and cut their cycles; of a BVH release the first frame is a rest pose."""
    return concat([cycles_of(read_trial(trial, data), most) for trial, most in trials.items()])


def read_walks(data: Path | None) -> Walks:
    """Read everything the study is about."""
    training, test, strides = (cut(trials, data) for trials in (TRAINING, TEST, STRIDES))
    encoding = learn_cycle_encoding(training)

    def features(motion: xr.Dataset) -> np.ndarray:
        return encoding.scaled(motion).reshape(len(split(motion)), -1, len(encoding.mean))

    scaled = {f"{scale:g}": features(diversified(test, scale)) for scale in TEST_SCALES}
    return Walks(training, {**scaled, "stride": features(strides)}, encoding)
