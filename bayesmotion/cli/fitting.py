"""The command ``check``, and what commands ``fit MODEL`` that are written by hand share."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from .. import console
from .fit_options import (
    MAP_STEPS,
    Run,
)

if TYPE_CHECKING:
    import xarray as xr

    from ..fit import Fit
    from ..model import Fittable


def check(
    files: Annotated[
        list[Path], typer.Argument(help="Recordings: .amc, .bvh, .c3d or a saved .nc.")
    ],
) -> None:
    """Look recordings over: rest poses, jumps, frozen stretches, feet below the floor.

    Tells what was found and which frames to drop. The exit code is 1 if anything was found.
    """
    from ..motion.check import check as findings_of
    from ..motion.io import read
    from ..motion.recordings import told

    count = 0
    for path in files:
        findings = findings_of(read(path))
        count += len(findings)
        if not findings:
            console.say(f"{path}: nothing found")
        for finding in findings:
            console.say(f"{path}: {told(finding)}")
    if count:
        raise typer.Exit(1)


def fitted(
    program: "Fittable",
    motion: "xr.Dataset",
    run: Run,
    out: Path,
    filter: str,
    preparation: dict[str, Any] | None = None,
) -> None:
    """Fit a model as asked for, save it, and say how it went."""
    if run.part is None:
        result = _mode(program, motion, run, preparation)
    else:
        result = _draws(program, motion, run, run.part, preparation)
    result.tree.attrs["reading"] = json.dumps({"filter": filter})
    result.save(out)
    if run.part is not None:
        run.part.unlink(missing_ok=True)
    _tell(result)
    console.say(f"saved to {out}")


def _mode(
    program: "Fittable", motion: "xr.Dataset", run: Run, preparation: dict[str, Any] | None
) -> "Fit":
    from ..inference.map import fit_map

    settings = {"starts": 4, "max_steps": MAP_STEPS, **run.options}
    with console.progress("fit", settings["max_steps"]) as progress:
        return fit_map(
            program, motion, seed=run.seed, keep=min(2, settings["starts"]), progress=progress,
            preparation=preparation, **settings,
        )  # fmt: skip


def _draws(
    program: "Fittable",
    motion: "xr.Dataset",
    run: Run,
    part: Path,
    preparation: dict[str, Any] | None,
) -> "Fit":
    from ..inference.ensemble import fit_ensemble
    from ..inference.nuts import fit_nuts

    settings = {"warmup": 500, "draws": 500, **run.options}
    how: dict[str, Any] = {"seed": run.seed, "checkpoint": part, "resume": run.resume}
    how["preparation"] = preparation
    total = settings["warmup"] + settings["draws"]
    try:
        with console.progress(run.method, total) as progress:
            if run.method == "nuts":
                return fit_nuts(program, motion, progress=progress, **how, **settings)
            settings["steps"] = settings["draws"]
            return fit_ensemble(program, motion, progress=progress, **how, **settings)
    except KeyboardInterrupt:
        if part.exists():
            console.note(f"{part} has the draws so far; --resume goes on from there")
        raise


def _tell(result: "Fit") -> None:
    """Say in one line how the fit went, and what to know before trusting it."""
    stats = result.tree["sample_stats"].ds
    seconds, best = float(result.tree.attrs["seconds"]), float(stats["lp"].values.max())
    if result.point_estimate:
        steps = int(stats["steps"].values.max())
        end = "converged" if stats["converged"].values.all() else "not converged"
        console.say(f"{end} after {steps} steps and {seconds:.1f} seconds, log density {best:.2f}")
        return
    chains, draws = stats.sizes["chain"], stats.sizes["draw"]
    many = f"{chains} chains of {draws} draws" if chains > 1 else f"{draws} draws"
    console.say(f"{many} in {seconds:.1f} seconds, best log density {best:.2f}")
    for warning in json.loads(result.tree.attrs["warnings"]):
        console.note(f"warning: {warning}")


def factors_of(text: str | None, motion: "xr.Dataset", labels: Path | None) -> list[str]:
    """Name the factors: those asked for, else the columns of the table, else all labels."""
    from ..motion.dataset import label_names
    from ..motion.labels import read_labels

    if text is not None:
        return [] if text in ("", "none") else [name.strip() for name in text.split(",")]
    if labels is None:
        return label_names(motion)
    return list(dict.fromkeys(name for row in read_labels(labels).rows.values() for name in row))
