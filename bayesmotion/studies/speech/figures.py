"""Pictures of the speech study: errors of all repeats, and trajectories of one utterance."""

from pathlib import Path
from typing import Any

import numpy as np

from ...intervals import NINETY
from ...sensing.face.views import FRAME_RATE
from .data import COORDINATES

NAMES = {
    "sgplvm_a": "shared GPLVM A",
    "sgplvm_b": "shared GPLVM B",
    "sgplvm_window": "shared, window",
    "voice_puppetry": "voice puppetry",
    "ridge": "ridge",
    "gp_regression": "GP regression",
}
SHOWN = ("lower lip z", "tongue tip z")


def draw_figures(result: dict[str, Any], tracks: Path, out: Path) -> None:
    """Draw ``speech_errors.png`` and, of what is in `tracks`, ``speech_tracks.png``."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 3.5), layout="constrained")
    axes = figure.subplots()
    repeats = list(result["repeats"].values())
    axes.boxplot([[one[name]["rms_mm"] for one in repeats] for name in NAMES])
    axes.set_xticks(range(1, len(NAMES) + 1), list(NAMES.values()), rotation=15)
    axes.set_ylabel("error in mm (root mean square)")
    figure.savefig(out / "speech_errors.png", dpi=120)

    figure = Figure(figsize=(10, 11), layout="constrained")
    for row, name in zip(figure.subplots(len(NAMES), len(SHOWN)), NAMES, strict=True):
        with np.load(tracks / f"{name}.npz") as stored:
            kept = {key: stored[key] for key in stored.files}
        for axes, shown in zip(row, SHOWN, strict=True):
            _track(axes, kept, COORDINATES.index(shown))
            axes.set_ylabel("mm")
            axes.set_title(f"{NAMES[name]}: {shown}", fontsize=9)
    figure.savefig(out / "speech_tracks.png", dpi=110)


def _track(axes: Any, kept: dict[str, np.ndarray], column: int) -> None:
    time = np.arange(len(kept["true"])) / FRAME_RATE
    axes.plot(time, kept["true"][:, column], color="0.4", label="recorded")
    mean = kept["mean"][:, column]
    axes.plot(time, mean, color="C0", label="from sound")
    if "spread" in kept:
        wide = NINETY * kept["spread"][:, column]
        axes.fill_between(time, mean - wide, mean + wide, color="C0", alpha=0.2, linewidth=0)
    axes.legend(fontsize=7, loc="upper right")
