"""Pictures of the multifactor study: latent spaces, the grid, samples, transitions."""

from pathlib import Path

import numpy as np

from ...fit import Fit
from ...motion.io.bvh import write_bvh
from ...motion.joining import split
from ...plots import compare, content_path, grid, save, styles
from ...tasks.synthesise import sampled, styles_of, synthesize, transition
from ..fits import multifactor_of

MISSING = (("02", "stride"), ("35", "stride"), ("08", "run"))
SECONDS = 2.0
SAMPLES = (1, 2, 3)


def draw_figures(fits: dict[str, Fit], out: Path) -> None:
    """Draw the latent spaces of every model, and Figures 2 to 4 with the stylistic circle."""
    for name, fit in fits.items():
        model, training = multifactor_of(fit)
        content = np.asarray(model.condition(training.frames, fit.values()).points["content"])
        clips = np.array(training.clips)[np.asarray(training.frames.clip)]
        save(content_path(content, clips), out / f"latent_{name}.png")
    circle = fits["cdm_style"]
    for factor, levels in styles_of(circle).items():
        vectors = circle.values()[f"style_{factor}"]
        save(styles(vectors, levels, title=factor), out / f"styles_{factor}.png")
    draw_grid(circle, out)
    draws = [sampled(circle, SECONDS, seed) for seed in SAMPLES]
    rows = {f"sample {seed}": draw.motion for seed, draw in zip(SAMPLES, draws, strict=True)}
    save(compare(rows), out / "figure3_samples.png")
    paths = {"walk to run": ("walk", "run"), "run to stride": ("run", "stride")}
    moving = {
        name: transition(circle, {"subject": "02"}, "gait", path, 2 * SECONDS).motion
        for name, path in paths.items()
    }
    save(compare(moving, count=12), out / "figure4_transitions.png")


def draw_grid(fit: Fit, out: Path) -> None:
    """Draw Figure 2 and write the cells nobody recorded as BVH."""
    cells = {
        (str(part["subject"].values[0]), str(part["gait"].values[0])): part
        for part in split(fit.motion).values()
    }
    for subject, gait in MISSING:
        made = synthesize(fit, {"subject": subject, "gait": gait}, SECONDS).motion
        cells[subject, gait] = made
        write_bvh(made, out / f"{subject}_{gait}.bvh")
    save(grid(cells, set(MISSING)), out / "figure2_grid.png")
