"""The denoising study's results as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.denoising.report docs/denoising.md docs/results/denoising.json``
writes them into the page's block.
"""

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..tables import table, write_results
from .study import VARIANTS, best_cutoff, best_variant

NAMES = {
    "measured": "as measured",
    "laboratory": "Butterworth, 6 Hz",
    "best_cutoff": "Butterworth, best cut-off",
    "known": "`bm.denoise`, noise known",
    "estimated": "`bm.denoise`, noise estimated",
}


def markdown(result: Mapping[str, Any]) -> str:
    """Return the tables of what has been done."""
    parts = []
    if set(result.get("variants", {})) == set(VARIANTS):
        parts.append(_choices(result))
    trials = result.get("trials", {})
    levels = [f"{noise:g}" for noise in result["settings"]["noises_degrees"]] if trials else []
    done = {name: one for name, one in trials.items() if set(levels) <= set(one)}
    if done:
        parts += [_errors(result, done, levels), _verdict(done, levels), _intervals(done, levels),
                  _trials(done, levels)]  # fmt: skip
    return "\n\n".join(parts)


def _choices(result: Mapping[str, Any]) -> str:
    levels = list(result["cutoff_hz"])
    rows = []
    for name, errors in result["variants"].items():
        shown = f"**{name}**" if name == best_variant(result) else name
        rows.append([shown, *(f"{errors[level]:.2f}" for level in levels)])
    for hz in result["cutoff_hz"][levels[0]]:
        errors = [result["cutoff_hz"][level] for level in levels]
        best = [best_cutoff(result, float(level)) == float(hz) for level in levels]
        cells = [f"**{one[hz]:.2f}**" if bold else f"{one[hz]:.2f}"
                 for bold, one in zip(best, errors, strict=True)]  # fmt: skip
        rows.append([f"Butterworth, {hz} Hz", *cells])
    count = len(result["settings"]["training"])
    head = ["", *(f"{level}°" for level in levels)]
    return (f"Mean error in millimetres over {count} training trials; what is bold was chosen:\n\n"
            + table(head, rows))  # fmt: skip


def _values(done: Mapping[str, Any], level: str, *keys: str) -> np.ndarray:
    found = []
    for one in done.values():
        value = one[level]
        for key in keys:
            value = value[key]
        found.append(value)
    return np.array(found)


def _errors(result: Mapping[str, Any], done: Mapping[str, Any], levels: list[str]) -> str:
    rows = []
    for name, title in NAMES.items():
        cells = []
        for level in levels:
            values = _values(done, level, "error_mm", name)
            error = values.std(ddof=1) / np.sqrt(len(values)) if len(values) > 1 else 0.0
            cells.append(f"{values.mean():.2f} ± {error:.2f}")
        rows.append([title, *cells])
    for name in ("known", "estimated"):
        cells = []
        for level in levels:
            ratio = _ratio(done, level, name)
            better = int((ratio < 1.0).sum())
            cells.append(f"{ratio.mean():.2f} ({better} of {len(ratio)})")
        rows.append([f"{NAMES[name]}, in that of 6 Hz (trials where it is less)", *cells])
    cuts = ", ".join(f"{best_cutoff(result, float(level)):g} Hz at {level}°" for level in levels)
    head = ["", *(f"{level}°" for level in levels)]
    told = f"Mean error in millimetres over {len(done)} test trials and its standard error."
    told += f" The best cut-offs for the training trials are {cuts}.\n\n"
    return told + table(head, rows)


def _ratio(done: Mapping[str, Any], level: str, name: str) -> np.ndarray:
    return _values(done, level, "error_mm", name) / _values(done, level, "error_mm", "laboratory")


def _verdict(done: Mapping[str, Any], levels: list[str]) -> str:
    """Return where the filter is the better one, in a sentence."""
    worse = [level for level in levels
             if _values(done, level, "error_mm", "estimated").mean()
             > _values(done, level, "error_mm", "laboratory").mean()]  # fmt: skip
    if worse:
        return f"At {' and '.join(worse)} degrees the 6 Hz filter is nearer: use that."
    lost = [f"{name} ({', '.join(bad)})" for name, one in done.items()
            if (bad := [f"{level}°" for level in levels
                        if one[level]["error_mm"]["estimated"]
                        > one[level]["error_mm"]["laboratory"]])]  # fmt: skip
    told = "In the mean over trials `bm.denoise` is nearer than the 6 Hz filter at every level."
    return f"{told} The filter is nearer for {', '.join(lost)}." if lost else told


def _intervals(done: Mapping[str, Any], levels: list[str]) -> str:
    rows = []
    for level in levels:
        held = [f"{100 * _values(done, level, 'coverage', name, share).mean():.0f} %"
                for name in ("known", "estimated") for share in ("50", "90")]  # fmt: skip
        noise = _values(done, level, "noise_degrees")
        seconds = [_values(done, level, "seconds", name) for name in ("known", "estimated")]
        frames = _values(done, level, "frames")
        rows.append([
            f"{level}°", *held, f"{noise.mean():.2f}° ({noise.min():.2f} to {noise.max():.2f})",
            *(f"{1000 * each.sum() / frames.sum():.1f}" for each in seconds),
        ])  # fmt: skip
    head = ["noise", "50 %, known", "90 %, known", "50 %, estimated", "90 %, estimated",
            "noise estimated", "s / 1000 frames, known", "estimated"]  # fmt: skip
    return "Share of angles in their intervals, the noise found, and time:\n\n" + table(head, rows)


def _trials(done: Mapping[str, Any], levels: list[str]) -> str:
    rows = []
    for name, one in done.items():
        cells = [f"{one[level]['error_mm']['laboratory']:.1f} / "
                 f"{one[level]['error_mm']['estimated']:.1f}" for level in levels]  # fmt: skip
        rows.append([name, str(one[levels[0]]["frames"]), *cells])
    head = ["trial", "frames", *(f"{level}°" for level in levels)]
    return "Every trial, 6 Hz filter / `bm.denoise` without knowing the noise:\n\n" + table(
        head, rows
    )


if __name__ == "__main__":
    write_results("denoising", markdown, *sys.argv[1:])
