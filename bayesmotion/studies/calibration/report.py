"""The calibration study's results as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.calibration.report docs/calibration.md
docs/results/calibration.json`` writes them into the page's block.
"""

import sys
from collections.abc import Mapping
from typing import Any

from ...evaluate.sbc.controls import GROSS, SUBTLE
from ..tables import table, write_results

NAMES = {
    "prior": "prior sd x 1/3",
    "frames": "frames shuffled",
    "noise": "noise variance x 4",
    "narrow_prior": "prior sd x 2/3",
    "noise_sd": "noise sd x 1.2",
    "lag": "one row late",
}


def markdown(result: Mapping[str, Any]) -> str:
    """Return the tables of the models the study has come to."""
    models = result.get("models", {})
    whole = {name: one for name, one in models.items() if "none" in one}
    if not whole:
        return ""
    settings = result["settings"]
    parts = [
        f"{settings['simulations']} simulations a calibration; p-values of the worst quantity, "
        "times the number of quantities:\n\n" + _calibrated(whole),
        f"Subtle faults: power of {settings['simulations']} simulations at the "
        f"{settings['level']:.0%} level, estimated from "
        f"{settings['batches'] * settings['simulations']}, with its standard error:\n\n"
        + _powers(whole),
    ]
    parts += [_again(name, one) for name, one in whole.items() if "again" in one]
    refused = [f"- {name}: {one['refused']}" for name, one in models.items() if "refused" in one]
    if refused:
        parts.append("Not calibrated:\n\n" + "\n".join(refused))
    if result.get("to_come"):
        parts.append(f"Not calibrated in full yet: {', '.join(result['to_come'])}.")
    return "\n\n".join(parts)


def _calibrated(models: Mapping[str, Any]) -> str:
    head = ["model", "calibrated", "corrected p", "quantities", "divergent", "autocorrelation",
            *(NAMES[control] for control in GROSS), "seconds"]  # fmt: skip
    rows = []
    for name, one in models.items():
        none, gross = one["none"], one.get("gross", {})
        caught = [_caught(gross.get(control)) for control in GROSS]
        rows.append([
            name, "yes" if one.get("again", none)["calibrated"] else "**no**",
            f"{_corrected(none):.2g}",
            str(len(none["p_values"])),
            f"{none['simulations_with_divergences']} of {none['simulations']}",
            f"{none['largest_autocorrelation']:.2f}", *caught, f"{none['seconds']:.0f}",
        ])  # fmt: skip
    return table(head, rows)


def _again(name: str, one: Mapping[str, Any]) -> str:
    again = one["again"]
    end = "did not refuse it" if again["calibrated"] else "refused it too"
    return (
        f"{name} was refused by its first calibration (p = {_corrected(one['none']):.2g}); "
        f"{again['simulations']} simulations from another seed {end} "
        f"(p = {_corrected(again):.2g})."
    )


def _corrected(one: Mapping[str, Any]) -> float:
    p = one["p_values"].values()
    return min(1.0, min(p) * len(p))


def _caught(one: Mapping[str, Any] | None) -> str:
    if one is None:
        return ""
    return "**not found**" if one["calibrated"] else "found"


def _powers(models: Mapping[str, Any]) -> str:
    rows = []
    for name, one in models.items():
        found = [one.get("subtle", {}).get(control) for control in SUBTLE]
        cells = ["" if each is None else f"{each['power']['share']:.2f} "
                 f"({each['power']['error']:.2f})" for each in found]  # fmt: skip
        rows.append([name, *cells])
    return table(["model", *(NAMES[control] for control in SUBTLE)], rows)


if __name__ == "__main__":
    write_results("calibration", markdown, *sys.argv[1:])
