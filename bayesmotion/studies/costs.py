"""What training took in the studies, from their files of results."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

# By model: its study, and what the study's results say of the training.
TOLD: dict[str, tuple[str, Callable[[Any], str]]] = {
    "multifactor": ("multifactor", lambda told: _of(
        "the mode", f"{len(told['settings']['training'])} clips of CMU",
        told["seconds"]["training"]["cdm_style"])),
    "gait_pose": ("gait-pose", lambda told: _of(
        "local learning", f"{told['training_cycles']} gait cycles",
        told["training"]["torus3"]["seconds"])),
    "voxel_pose": ("voxel", lambda told: _of(
        "EM", f"{sum(told['frames']['training'].values()):,} frames and their mirror images",
        told["seconds"]["training"])),
    "shared_gplvm": ("speech", lambda told: _of(
        "the mode", f"{told['settings']['training']} utterances",
        told["ema"]["sgplvm_window"]["training_seconds"][0])),
    "voice_puppetry": ("speech", lambda told: _of(
        "EM", f"{told['settings']['training']} utterances",
        told["ema"]["voice_puppetry"]["training_seconds"][0])),
}  # fmt: skip


def training_costs(results: Path) -> dict[str, str]:
    """Return by model how long its study trained it, in words.

    Parameters
    ----------
    results
        Folder of the studies' JSON files.
    """
    return {
        model: words(json.loads((results / f"{study}.json").read_text(encoding="utf-8")))
        for model, (study, words) in TOLD.items()
    }


def _of(method: str, recordings: str, seconds: float) -> str:
    return f"{method}, {recordings}: {seconds:.0f} s"
