"""Clips for the motion tensor's example: a posture of each person, a movement of each task."""

import numpy as np
import xarray as xr

from ...motion.dataset import make_motion
from ...motion.joining import concat
from ...motion.segments import LEAVE_OUT
from ...motion.synthetic.anthropometry import adult_skeleton

PEOPLE, TASKS, REPETITIONS = ("ann", "ben", "cat"), ("bow", "wave"), 3
FRAMES, FRAME_RATE, STATURE = 30, 30.0, 1.7
# Standard deviations in radians of what people, tasks, cells and repetitions differ by.
PERSON, TASK, CELL, REPETITION = 0.15, 0.3, 0.05, 0.04


def example(seed: int) -> xr.Dataset:
    """Make the clips, called person-task-repetition."""
    random = np.random.default_rng(seed)
    skeleton = adult_skeleton("body", STATURE)
    # Joints that segments leave out stay at rest.
    moves = np.array([not any(w in dof for w in LEAVE_OUT) for dof in skeleton.dofs], float)
    phase = np.linspace(0.0, np.pi, FRAMES)[:, None]

    def drawn(size: float) -> np.ndarray:
        return size * moves * random.normal(size=len(moves))

    posture = {person: drawn(PERSON) for person in PEOPLE}
    movement = {task: (drawn(TASK), drawn(TASK)) for task in TASKS}
    clips = []
    for person in PEOPLE:
        for task in TASKS:
            sine, cosine = movement[task]
            cell = posture[person] + drawn(CELL)
            for repetition in range(REPETITIONS):
                angle = cell + drawn(REPETITION) + sine * np.sin(phase) + cosine * np.cos(phase)
                clips.append(
                    make_motion(
                        skeleton,
                        angle,
                        np.zeros((FRAMES, 3)),
                        frame_rate=FRAME_RATE,
                        clip=f"{person}-{task}-{repetition}",
                        labels={"subject": person, "task": task},
                    )
                )
    return concat(clips)
