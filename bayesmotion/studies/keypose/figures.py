"""Pictures of the keypose study: confusion matrices, curves, calibration."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from ...plots import save, style


def draw_figures(result: dict[str, Any], out: Path) -> None:
    """Draw everything from the study's numbers."""
    draw_confusion(result["known"], out / "confusion.png")
    draw_calibration(result, out / "calibration.png")
    draw_variance(result["pca"]["dances"], out / "figure11_variance.png")
    draw_synthetic(result["synthetic"], out / "figures4_5_thresholds.png")


def draw_confusion(known: dict[str, Any], path: Path) -> None:
    """Draw which levels the Bayesian tensor takes for which."""
    figure = style.new_figure(style.WIDTH, 3.6)
    axes = figure.subplots(1, 2, width_ratios=[5, 11])
    for ax, mode in zip(axes, ("subject", "task"), strict=True):
        true, named = known["true"][mode], known["named"][mode]
        levels = sorted(set(true) | set(named))
        table = np.zeros((len(levels), len(levels)))
        for one, other in zip(true, named, strict=True):
            table[levels.index(one), levels.index(other)] += 1
        share = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
        ax.imshow(share, cmap="Blues", vmin=0, vmax=1)
        for i, j in np.argwhere(table > 0):
            colour = "white" if share[i, j] > 0.5 else style.INK
            ax.text(j, i, f"{table[i, j]:.0f}", ha="center", va="center",
                    fontsize=style.SMALL - 1, color=colour)  # fmt: skip
        style.tidy(ax, x=f"named {mode}", y=f"true {mode}")
        ax.set_xticks(range(len(levels)), [name[:12] for name in levels], rotation=90)
        ax.set_yticks(range(len(levels)), [name[:12] for name in levels])
    save(figure, path)


def draw_calibration(result: dict[str, Any], path: Path) -> None:
    """Draw how often the class named is right against its probability."""
    figure = style.new_figure(style.WIDTH, 2.8)
    for ax, split in zip(figure.subplots(1, 2), ("known", "known_all_repetitions"), strict=True):
        ax.plot([0, 1], [0, 1], color=style.RULE, linewidth=style.HAIR)
        for (mode, title), colour in zip(
            (("task", "task"), ("subject", "person")), style.SERIES, strict=False
        ):
            bins = result[split]["calibration"][mode]
            ax.plot(bins["confidence"], bins["right"], color=colour, linewidth=style.LINE)
            ax.scatter(bins["confidence"], bins["right"], s=3 + np.sqrt(bins["n"]) * 4,
                       color=colour, label=title)  # fmt: skip
        style.tidy(ax, x="probability of the class named", y="share right")
        ax.set_title(split.replace("_", " "), fontsize=style.TITLE, color=style.INK)
        handles, labels = ax.get_legend_handles_labels()
        style.key(ax, handles, labels, loc="upper left")
    save(figure, path)


def draw_variance(dances: dict[str, Any], path: Path) -> None:
    """Draw the variance covered by components of keyposes and of uniform poses (Figure 11)."""
    figure = style.new_figure(style.WIDTH, 2.8)
    left, right = figure.subplots(1, 2)
    for name, colour in (("keypose", style.BLUE), ("uniform", style.VERMILION)):
        curves = np.array([row[name] for row in dances.values()])
        steps = np.arange(1, curves.shape[1] + 1)
        left.plot(steps, curves.T, color=colour, linewidth=style.HAIR, alpha=0.4)
        left.plot(steps, curves.mean(axis=0), color=colour, linewidth=2, label=name)
    style.tidy(left, x="components", y="share of the variance")
    handles, labels = left.get_legend_handles_labels()
    style.key(left, handles, labels, loc="lower right")
    third = np.array([[row[name][2] for name in ("uniform", "keypose")] for row in dances.values()])
    ends = [third.min(), third.max()]
    right.plot(ends, ends, color=style.RULE, linewidth=style.HAIR)
    right.scatter(third[:, 0], third[:, 1], s=16, color=style.BLUE)
    style.tidy(right, x="three components of uniform poses", y="of keyposes")
    save(figure, path)


def draw_synthetic(synthetic: dict[str, Any], path: Path) -> None:
    """Draw precision and recall over T_1, T_2, noise and drift (Figures 4 and 5)."""
    figure = style.new_figure(style.WIDTH, 4.2)
    names = {"T1": "T_1 (m/s), T_2 never", "T2": "T_2 (m/s), T_1 never",
             "noise": "noise (rad)", "drift": "drift (s)"}  # fmt: skip
    for ax, (name, title) in zip(figure.subplots(2, 2).flat, names.items(), strict=True):
        _curves(ax, synthetic[name], name)
        style.tidy(ax, x=title, y="share")
        ax.set_ylim(0, 1.03)
        handles, labels = ax.get_legend_handles_labels()
        style.key(ax, handles, labels, loc="lower right")
    save(figure, path)


def _curves(ax: Axes, rows: list[dict[str, float]], name: str) -> None:
    """Draw precision and recall over one setting."""
    x = [row[name] for row in rows]
    for what, colour in (("precision", style.BLUE), ("recall", style.VERMILION)):
        ax.plot(x, [row[what] for row in rows], color=colour, marker="o", markersize=3,
                linewidth=style.LINE, label=what)  # fmt: skip
