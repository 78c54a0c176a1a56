"""The posterior study's results as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.posterior.report docs/posterior.md docs/results/posterior.json``
writes them into the page's block. Stages the file does not hold are left out.
"""

import sys
from collections.abc import Mapping
from typing import Any

from ..multifactor.report import NAMES
from ..tables import table, write_results

KINDS = {
    "map_gpdm": "mode, GPDM",
    "map_gpdm_style": "mode, stylistic GPDM",
    "map_bgpdm": "mode, B-GPDM",
    "map_bgpdm_style": "mode, stylistic B-GPDM",
    "map": "mode",
    "posterior": "posterior",
    "map_cdm_style_own": "mode, own residuals",
    "posterior_cdm_style_own": "posterior, own residuals",
    "map_cdm_style_student": "mode, t process for new clips",
    "posterior_cdm_style_student": "posterior, t process for new clips",
    "map_cdm_style_novel": "mode, novel dimensions and t process",
    "posterior_cdm_style_novel": "posterior, novel dimensions and t process",
    "map_cdm_style_own_novel": "mode, own residuals, novel dimensions and t process",
    "posterior_cdm_style_own_novel": "posterior, own residuals, novel dimensions and t process",
    "stacked_plain": "stacked, the three stylistic models as they are",
    "stacked": "stacked, the circle as it sees new people",
}
SAMPLED = {
    "cdm_style": NAMES["cdm_style"],
    "cdm_style_own": NAMES["cdm_style_own"],
    "gpdm_style": f"{NAMES['gpdm_style']}, path in a plane",
    "gpdm_style_space": f"{NAMES['gpdm_style']}, path in space",
}
RESIDUALS = {"cdm_style": "of one size", "cdm_style_own": "each clip's own"}
VARIANTS = {
    "cdm_style": NAMES["cdm_style"],
    "cdm_style_student": "circle, t process",
    "cdm_style_novel": "circle, novel dimensions and t process",
    "cdm_style_own_novel": "circle, own residuals, novel dimensions and t process",
}


def markdown(result: Mapping[str, Any]) -> str:
    """Give the tables of the stages the study has come to."""
    parts = [_sampling(result)]
    if "left_out" in result:
        parts.append(_left_out(result["left_out"]))
    if "mean_error" in result["forecast"]:
        parts.append(_forecasts(result["forecast"]))
    if "clip_posteriors" in result:
        parts.append(_two_samplers(result["clip_posteriors"]))
    if "compare" in result:
        parts.append(_compared(result["compare"]))
    if "scales" in result:
        parts.append(_scales(result["scales"]))
    if "sbc" in result:
        parts.append(_calibration(result["sbc"]))
    return "\n\n".join(parts)


def _sampling(result: Mapping[str, Any]) -> str:
    rows = [
        [
            label,
            ", ".join(one["clips"]),
            f"{one['max_r_hat']:.3f}",
            f"{one['naive_max_r_hat']:.3f}",
            f"{one['turned_max_r_hat']:.1f}" if "turned_max_r_hat" in one else "",
            f"{one['min_ess_bulk']:.0f}",
            f"{one['divergences']:.0f}",
            f"{one['seconds']:.0f}",
        ]
        for name, label in SAMPLED.items()
        if (one := result.get(name))
    ]
    head = [
        "model",
        "clips",
        "R-hat",
        "R-hat of raw sites",
        "turned",
        "bulk ESS",
        "divergences",
        "seconds",
    ]
    text = (
        "Sampling: the largest R-hat and the smallest bulk ESS of all identified quantities; "
        "beside it the largest R-hat of the sites as they are, and that of the same draws with "
        "the latent path of each chain turned in its own way, which no data can tell:"
    )
    return f"{text}\n\n{table(head, rows)}"


def _left_out(found: Mapping[str, Any]) -> str:
    rows = [
        [
            RESIDUALS[base],
            novel,
            "Gaussian process" if name == "None" else f"{float(name):g}",
            f"{one['error']:.3f}",
            f"{one['crps']:.4f}",
            f"{one['log_score']:.2f}",
            f"{100 * one['coverage90']:.0f} %",
        ]
        for base, tried in found.items()
        for novel, told in tried.items()
        for name, one in told["scores"].items()
        if name in ("None", str(told["student_df"]))
    ]
    head = [
        *("residuals", "novel dimensions", "degrees of freedom"),
        *("error", "CRPS", "log score", "cover"),
    ]
    text = (
        "Training clips of people left out, forecast at the mode, as Gaussian processes and with "
        "the degrees of freedom that have the highest log score:"
    )
    return f"{text}\n\n{table(head, rows)}"


def _forecasts(found: Mapping[str, Any]) -> str:
    rows = [
        [
            label,
            f"{found['mean_error'][kind]:.3f}",
            f"{found['crps'][kind]:.4f}",
            f"{found['log_score'][kind]:.2f}",
            f"{100 * found['coverage90'][kind]:.0f} %",
        ]
        for kind, label in KINDS.items()
        if kind in found["mean_error"]
    ]
    head = ["forecast", "mean error", "CRPS", "log score", "90 % intervals cover"]
    text = "Forecasts of the eight test clips, means over the clips (angles, radians):"
    return f"{text}\n\n{table(head, rows)}"


def _two_samplers(found: Mapping[str, Mapping[str, Mapping[str, Any]]]) -> str:
    rows = [
        [
            VARIANTS[name],
            clip,
            f"{one['worst_difference_in_mcse']:.1f}",
            f"{one['nuts_max_r_hat']:.3f}",
            f"{one['nuts_min_ess']:.0f}",
            f"{one['nuts_divergences']}",
            f"{one['ensemble_autocorrelation']:.0f}",
            "yes" if one["ensemble_long_enough"] else "no",
        ]
        for name, clips in found.items()
        for clip, one in clips.items()
    ]
    head = [
        "model",
        "clip",
        "largest difference of means, in MCSE",
        "R-hat (NUTS)",
        "ESS (NUTS)",
        "divergences (NUTS)",
        "tau (ensemble)",
        "ensemble long enough",
    ]
    return "A clip's own unknowns by NUTS and by an ensemble:\n\n" + table(head, rows)


def _compared(found: Mapping[str, Any]) -> str:
    head = ["model", "elpd", "difference", "se over clips", "stacking weight"]
    parts = []
    for field, what in (
        ("leave_future_out", f"The last {found['horizon']} frames of every training clip"),
        ("leave_clips_out", "Every training clip, forecast by a fit to the others"),
        ("stacked", "For the stack, every training clip, forecast by a fit to the others"),
    ):
        if field not in found:
            continue
        rows = [
            [
                {**NAMES, **VARIANTS}[str(row["fit"])],
                f"{row['elpd']:.0f}",
                f"{row['elpd_diff']:.0f}",
                f"{row['dse_clips']:.0f}",
                f"{row['weight']:.2f}",
            ]
            for row in found[field]
        ]
        parts.append(f"{what}, left out and predicted:\n\n{table(head, rows)}")
    agree = found["rank_correlation"]
    parts.append(
        "Rank correlation with how near the forecasts of the test clips come: "
        f"{agree['leave_future_out']:.1f} by the future left out, "
        f"{agree['leave_clips_out']:.1f} by clips left out."
    )
    return "\n\n".join(parts)


def _scales(found: Mapping[str, Mapping[str, float]]) -> str:
    rows = [
        [
            label,
            f"{one['min_ess_bulk']:.0f}",
            f"{one['seconds']:.0f}",
            f"{one['ess_a_second']:.2f}",
            f"{one['leapfrogs']:.0f}",
            f"{one['max_r_hat']:.3f}",
            f"{one['divergences']:.0f}",
        ]
        for label, one in (
            ("integrated out", found["integrated_out"]),
            ("sampled", found["sampled"]),
        )
    ]
    head = ["scales", "bulk ESS", "seconds", "ESS a second", "leapfrogs", "R-hat", "divergences"]
    text = "The scales of the outputs integrated out, or sampled with the rest (stylistic circle):"
    return f"{text}\n\n{table(head, rows)}"


def _calibration(found: Mapping[str, Mapping[str, Any]]) -> str:
    rows = []
    for name, one in found.items():
        caught = [control for control, each in one["controls"].items() if each["caught"]]
        verdict = "calibrated" if one["calibrated"] else "not calibrated"
        rows.append([name, verdict, f"{len(caught)} of {len(one['controls'])}"])
    return "Simulation-based calibration:\n\n" + table(
        ["small model", "verdict", "faults caught"], rows
    )


if __name__ == "__main__":
    write_results("posterior", markdown, *sys.argv[1:])
