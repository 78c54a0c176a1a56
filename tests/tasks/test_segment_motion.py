"""Back from segments to motions, and cells that nobody recorded."""

import numpy as np
import pytest

from bayesmotion.errors import InputError
from bayesmotion.inference.optimisation.map import fit_map
from bayesmotion.models.motion_tensor import MotionTensor
from bayesmotion.motion.kinematics import positions
from bayesmotion.motion.segments import Segmenting, body_of, segments
from bayesmotion.tasks.segment_motion import segment_motion, synthesise_cell


@pytest.fixture(scope="module")
def clips(acted):
    return acted(("ann", "ben", "cat"), ("wave", "bow"))


def test_all_coefficients_give_the_pose_back(clips):
    clip = clips.isel(frame=clips["clip"].values == "ann-wave-0")
    frames = clip.sizes["frame"]
    vector = segments(clip, Segmenting("rotations", frames, frames))[0]
    back = segment_motion(vector, body_of(clip), frames, 30.0, {"subject": "ann"})
    own = [positions(part).values for part in (clip, back)]
    seen = [p - p[:, :1] for p in own]
    # The heading was taken out: distances between joints tell the pose.
    gaps = [np.linalg.norm(p[:, :, None] - p[:, None], axis=-1) for p in seen]
    moving = [i for i, j in enumerate(body_of(clip)) if "finger" not in j.name
              and "thumb" not in j.name]  # fmt: skip
    error = np.abs(gaps[0] - gaps[1])[:, moving][:, :, moving]
    assert error.max() < 0.02
    assert own[1][..., 1].min(axis=1) == pytest.approx(0.0, abs=1e-9)


def test_a_cell_left_out_is_nearer_than_the_same_person_or_task(clips):
    away = clips["clip"].values == "cat-bow-0"
    model = MotionTensor(segmenting=Segmenting("rotations", coefficients=12))
    fit = fit_map(model, clips.isel(frame=~away), starts=1, keep=1)
    made = synthesise_cell(fit, {"subject": "cat", "task": "bow"})
    assert set(made["clip"].values) == {"cat-bow"}
    settings = Segmenting("rotations", 12)
    skeleton = body_of(fit.motion)
    true = segments(clips.isel(frame=away), settings, skeleton).values
    distance = {"made": np.linalg.norm(segments(made, settings, skeleton).values - true)}
    for other in ("cat-wave-0", "ann-bow-0"):
        clip = clips.isel(frame=clips["clip"].values == other)
        distance[other] = np.linalg.norm(segments(clip, settings, skeleton).values - true)
    assert distance["made"] < 0.5 * min(distance["cat-wave-0"], distance["ann-bow-0"])


def test_unknown_levels_and_vectors_without_rotations_are_refused(clips):
    model = MotionTensor(segmenting=Segmenting("positions"))
    fit = fit_map(model, clips, starts=1, keep=1)
    with pytest.raises(InputError, match="does not know it"):
        synthesise_cell(fit, {"subject": "dan", "task": "bow"})
    with pytest.raises(InputError, match="do not hold all rotations"):
        synthesise_cell(fit, {"subject": "ann", "task": "bow"})
