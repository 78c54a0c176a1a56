"""One measurement in a process: ``python -m bayesmotion.benchmarks.online DRAWS REPEATS``.

It is `Online.update` of one frame of 89 features at 30 frames a second, by a fit of synthetic
people: after few frames, and after many. With more draws than one the fit's draws are the mode
with another size of the noise each: what they cost does not depend on where they lie. A line of
JSON says what was found.
"""

import json
import sys
import time
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import MotionWarning
from ..fit import Fit
from ..inference.methods import MAP, fit
from ..models.multifactor import Multifactor
from ..motion.joining import split
from ..motion.synthetic.walkers import synthetic_walkers
from ..tasks.online import online

# After so many frames few have come, and many; a frame's part that is measured in turn.
FEW, MANY, EACH = 60, 600, 5
STEPS = 100
# How far the logarithms of the noise of draws are apart.
APART = 0.1


def updates(draws: int, repeats: int) -> dict[str, Any]:
    """Return CPU milliseconds of one update after few frames and after many: medians."""
    with warnings.catch_warnings():
        # What the fit is like is not the point.
        warnings.simplefilter("ignore", MotionWarning)
        people = synthetic_walkers(("ann", "ben"), ("walk", "run"), frame_rate=30.0, seconds=2.0)
        trained = with_draws(fit(Multifactor(), people, method=MAP(max_steps=STEPS)), draws)
        new = synthetic_walkers(("cas",), ("walk",), frame_rate=30.0, seconds=MANY / 30.0 + 4.0)
        following = online(trained, draws=draws)
    clip, found = next(iter(split(new).values())), {}
    for frame in range(MANY + EACH * repeats):
        one = clip.isel(frame=[frame])
        begun = time.process_time()
        following.update(one)
        found[frame] = 1e3 * (time.process_time() - begun)
    few, many = (
        float(np.median([found[frame] for frame in range(first, first + EACH * repeats)]))
        for first in (FEW, MANY)
    )
    return {"ms": many, "ms_after_few": few, "frames": MANY, "frames_few": FEW}


def with_draws(fit: Fit, draws: int) -> Fit:
    """Return a point estimate as a fit of so many draws, which differ in the noise."""
    tree, posterior = fit.tree.copy(), fit.tree["posterior"].to_dataset()
    many = posterior.isel(draw=np.zeros(draws, int)).assign_coords(draw=np.arange(draws))
    size = np.exp(APART * np.linspace(-1.0, 1.0, draws)) if draws > 1 else np.ones(1)
    tree["posterior"] = many.assign(beta=many["beta"] * size[None])
    return replace(fit, tree=tree)


if __name__ == "__main__":
    print(json.dumps(updates(*map(int, sys.argv[1:]))))
