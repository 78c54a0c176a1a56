"""The main job on an embedded example: people walk, run and stride, one clip is missing.

Three synthetic people were recorded in three gaits, but Ben's stride was not. The
multifactor model learns from the eight clips, makes the ninth, and says how a clip
goes on that it has seen the beginning of. Since the walkers are synthetic, the truth
about the missing clip is known.
"""

import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from ..errors import MotionWarning
from ..files import write_json
from ..fit import Fit
from ..inference.optimisation.map import fit_map
from ..models.multifactor import Multifactor
from ..motion.dataset import skeleton_of
from ..motion.features import encode, layout_of
from ..motion.io.bvh import write_bvh
from ..motion.joining import split
from ..motion.synthetic.walkers import SUBJECTS, Truth, synthetic_truth, synthetic_walkers
from ..plots import grid, save
from ..tasks.cycles import cycle_distance, fold
from ..tasks.forecast import Forecast, forecast
from ..tasks.forecast_scores import forecast_picture, forecast_scores
from ..tasks.synthesise import Synthesis, synthesize
from ..view.viewer import view

MISSING = {"subject": "ben", "gait": "stride"}
SECONDS, RATE, SEED = 1.3, 20.0, 0
CONTEXT, HORIZON = 15, 20
GHOSTS = 30
PAGE = "demo.html"
STARTS, STEPS = 1, 240


@dataclass(frozen=True)
class Demo:
    """What the demonstration showed.

    distances
        Mean distance in radians of the missing cell's true cycle to the synthesised one
        and to that of every training clip, by name; the synthesised one comes first.
    closest
        Whether the synthesised cycle is closer than that of any training clip.
    errors
        Mean error of the forecast in radians, and of holding the last pose.
    seconds
        What each part took.
    files
        What was written.
    """

    distances: dict[str, float]
    closest: bool
    errors: dict[str, float]
    seconds: dict[str, float]
    files: tuple[Path, ...]


def run(
    out: Path,
    *,
    steps: int = STEPS,
    progress: Callable[[int, float], None] | None = None,
) -> Demo:
    """Run the demonstration and write its files.

    Parameters
    ----------
    out
        Folder for the files; made where it is missing.
    steps
        At most so many steps of the fit.
    progress
        Called with the steps done and the best log density.
    """
    clock = _Clock()
    place = (MISSING["subject"], MISSING["gait"])
    settings = {"frame_rate": RATE, "seed": SEED}
    motion = synthetic_walkers(leave_out=[place], seconds=SECONDS, **settings)
    known = synthetic_truth(seconds=SECONDS, **settings)
    with warnings.catch_warnings():
        # A short search is enough to show the idea; demo.json says whether it converged.
        warnings.simplefilter("ignore", MotionWarning)
        fit = fit_map(
            Multifactor(), motion, seed=SEED, starts=STARTS, keep=1, max_steps=steps,
            progress=progress,
        )  # fmt: skip
    clock.stop("fit")
    made = synthesize(fit, MISSING, SECONDS)
    distances = _distances(known, motion, made)
    clock.stop("synthesis")
    # The same person in the same gait, seen for a moment: the model is told neither.
    longer = synthetic_walkers(seconds=(CONTEXT + HORIZON) / RATE, **settings)
    clip = split(longer)[known.grid.clip(**MISSING)]
    predicted = forecast(fit, clip, context=CONTEXT, horizon=HORIZON, samples=GHOSTS)
    errors = _errors(fit, clip, predicted)
    clock.stop("forecast")
    files = [out / "fit.nc", out / "cell.bvh", out / "forecast.bvh"]
    fit.save(files[0])
    write_bvh(made.motion, files[1])
    write_bvh(predicted.motion, files[2])
    title = f"{'-'.join(place)}, which was not recorded: {HORIZON} frames forecast from {CONTEXT}"
    moving = view(predicted, truth=clip, names=["forecast"], draws=GHOSTS, title=title)
    files += [moving.write(out / PAGE), *_pictures(out, motion, made, clip, predicted, fit)]
    files.append(out / "demo.json")
    clock.stop("files")
    result = Demo(distances, _first_is_least(distances), errors, clock.seconds, tuple(files))
    _write_json(files[-1], result, fit)
    return result


class _Clock:
    """Seconds that each part took."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def stop(self, part: str) -> None:
        """Note what passed since the last part."""
        now = time.perf_counter()
        self.seconds[part], self._last = now - self._last, now


def _distances(known: Truth, motion: xr.Dataset, made: Synthesis) -> dict[str, float]:
    """Compare the missing cell's true cycle with the synthesised one and every recorded one."""

    def cycle(part: xr.Dataset, phase: np.ndarray) -> np.ndarray:
        layout = layout_of(skeleton_of(part))
        return fold(encode(part, layout)[:, : layout.n_angles], phase)

    def phase_of(clip: str) -> np.ndarray:
        return known.phase.values[known.phase["clip"].values == clip]

    target = cycle(known.cell(**MISSING), phase_of(known.grid.clip(**MISSING)))
    distances = {"synthesised": cycle_distance(cycle(made.motion, made.phase), target)}
    for clip, part in split(motion).items():
        distances[clip] = cycle_distance(cycle(part, phase_of(clip)), target)
    return distances


def _first_is_least(distances: dict[str, float]) -> bool:
    """Tell whether the first of the distances is the smallest."""
    first, *others = distances.values()
    return first < min(others)


def _errors(fit: Fit, clip: xr.Dataset, predicted: Forecast) -> dict[str, float]:
    """Return the mean error of the forecast and of holding the last pose, in radians."""
    found = forecast_scores(fit, clip, predicted)
    assert found is not None, "the clip goes on for as long"
    return {"forecast": found.error, "hold the last pose": found.baselines["hold"]}


def _pictures(
    out: Path, motion: xr.Dataset, made: Synthesis, clip: xr.Dataset, predicted: Forecast, fit: Fit
) -> list[Path]:
    """Draw the grid with the missing cell filled in, and the forecast."""
    recorded = {
        (str(part["subject"].values[0]), str(part["gait"].values[0])): part
        for part in split(motion).values()
    }
    missing = (MISSING["subject"], MISSING["gait"])
    gaits = list(dict.fromkeys(gait for _, gait in recorded))
    cells = {
        (subject, gait): recorded.get((subject, gait), made.motion)
        for subject in SUBJECTS
        for gait in gaits
    }
    return [
        save(grid(cells, {missing}), out / "grid.png"),
        save(forecast_picture(fit, clip, predicted), out / "forecast.png"),
    ]


def _write_json(path: Path, result: Demo, fit: Fit) -> None:
    """Write what was shown as JSON."""
    stats = fit.tree["sample_stats"].ds
    content = {
        "missing": MISSING,
        "distances": result.distances,
        "closest": result.closest,
        "errors": result.errors,
        "seconds": result.seconds,
        "converged": bool(stats["converged"].values.all()),
        "steps": int(stats["steps"].values.max()),
    }
    write_json(path, content)
