"""The keypose study's results as Markdown, drawn from its JSON file.

``python -m bayesmotion.studies.keypose.report docs/keypose.md docs/results/keypose.json``
writes them into the page's block. Stages the file does not hold are left out.
"""

import sys
from collections.abc import Mapping
from typing import Any

from ..tables import table, write_results

NAMES = {
    "tensor_paper": "tensor, the paper's rule",
    "tensor_bayes": "tensor, Bayesian",
    "nearest": "nearest neighbour",
    "discriminant": "linear discriminant",
}
SPLITS = {
    "known": "one repetition a cell for training",
    "known_all_repetitions": "all repetitions but one for training",
}
VARIANTS = {
    "rotations": "rotations alone",
    "positions": "positions alone, one body",
    "positions_own_body": "positions alone, true bone lengths",
    "movement_only": "movement alone, no mean pose",
}


def markdown(result: Mapping[str, Any]) -> str:
    """Give the tables of the stages that were run, and what they say."""
    parts: list[str] = []
    if {"known", "known_all_repetitions"} <= set(result):
        parts.append(_known(result))
    if {"variants", "ranks"} <= set(result):
        parts.append(_variants(result))
    if "unseen" in result:
        parts.append(_unseen(result))
    if {"known", "known_all_repetitions"} <= set(result):
        parts.append(_calibration(result))
    if "missing_cells" in result:
        parts.append(_missing(result["missing_cells"]))
    if "pca" in result:
        parts.append(_dances(result))
    if "music" in result.get("beats", {}):
        parts.append(_music(result["beats"]["music"]))
    if "synthetic" in result:
        parts.append(_synthetic(result["synthetic"]))
    return "\n\n".join(parts)


def _share(found: Mapping[str, Any], title: str, model: str) -> str:
    low, high = found[f"{title}_interval"][model]
    return f"{found[title][model]:.3f} ({low:.2f} to {high:.2f})"


def _known(result: Mapping[str, Any]) -> str:
    chosen, paper = result["chosen"], result["paper"]["known"]
    parts = [
        "### Known persons and tasks\n\n"
        f"Chosen on the training segments: channels {chosen['channels']}, "
        f"{chosen['coefficients']} cosine coefficients. Share named right, with 95 % intervals "
        f"(the paper, on its own dances: tasks {paper['task']:.3f}, persons "
        f"{paper['person']:.3f})."
    ]
    for split, title in SPLITS.items():
        found = result[split]
        rows = [
            [NAMES[model], _share(found, "task", model), _share(found, "person", model)]
            for model in NAMES
        ]
        text = f"{title.capitalize()}, {found['n']} probes:"
        parts.append(f"{text}\n\n{table(['model', 'tasks', 'persons'], rows)}")
    ms = result["ms_per_probe"]
    parts.append(
        f"One probe by itself takes the Bayesian tensor {result['ms_one_probe']:.1f} ms; many "
        f"together {ms['tensor_bayes']:.2f} ms each, the paper's rule {ms['tensor_paper']:.2f} ms "
        f"(the paper: {result['paper']['seconds_per_probe']:.0f} s)."
    )
    return "\n\n".join(parts)


def _variants(result: Mapping[str, Any]) -> str:
    rows = []
    for name, title in VARIANTS.items():
        for split, meaning in SPLITS.items():
            found = result["variants"].get(name, {}).get(split)
            if found is None:
                continue
            cells = [_share(found, what, "tensor_bayes") for what in ("task", "person")]
            rows.append([title, meaning.split(" for")[0], *cells])
    ranks = [
        f"{rank}: tasks {found['task']['tensor_bayes']:.3f}, persons "
        f"{found['person']['tensor_bayes']:.3f}"
        for rank, found in result["ranks"].items()
    ]
    head = ["vectors", "training", "tasks", "persons"]
    return (
        "### What identifies a person\n\n"
        "The Bayesian tensor on other vectors. Rotations hold each actor's constant posture, "
        "part of which is how the skeleton was fitted to the actor; positions on one body hold "
        f"less of it, and movement alone none.\n\n{table(head, rows)}\n\n"
        "The position mode is not cut: the prior of the covariance shrinks what says little. "
        f"Cut to fewer columns (one repetition a cell), {'; '.join(ranks)}."
    )


def _unseen(result: Mapping[str, Any]) -> str:
    rows = []
    others, counts = [], []
    for kind, title, other in (("new_person", "person", "task"), ("new_task", "task", "person")):
        if kind not in result["unseen"]:
            continue
        found, paper = result["unseen"][kind], result["paper"]["unseen"][kind]
        counts.append(f"{len(found['chosen'])} {title}s")
        share = found["tensor_bayes"]["other_of_unseen"]["share"]
        others.append(f"the {other} of a new {title} in {share:.3f}")
        for model, name in (
            ("tensor_bayes", NAMES["tensor_bayes"]),
            ("positions_only", "the same, positions alone"),
            ("tensor_paper", NAMES["tensor_paper"]),
        ):
            cells = []
            for what in ("found", "false_alarms"):
                one = found[model][what]
                low, high = one["interval"]
                cells.append(f"{one['share']:.3f} ({low:.2f} to {high:.2f})")
            rows.append([f"new {title}", name, f"{paper:.3f}", *cells])
    head = ["left out", "model", "the paper found", "found", "false alarms"]
    return (
        "### Unseen persons and tasks\n\n"
        f"{' and '.join(counts)} left out, each in turn; channels and thresholds are chosen on "
        "the training segments alone, and false alarms are counted on the last repetition of "
        f"every other cell.\n\n{table(head, rows)}\n\n"
        f"Named right: {', '.join(others)} of the probes (the paper: the task of a new person in "
        f"{result['paper']['task_of_unseen_person']:.3f})."
    )


def _calibration(result: Mapping[str, Any]) -> str:
    rows = []
    for split, meaning in SPLITS.items():
        for mode, title in (("task", "task"), ("subject", "person")):
            one = result[split]["calibration"][mode]
            rows.append([
                title, meaning.split(" for")[0], f"{one['mean_confidence']:.3f}",
                f"{one['mean_right']:.3f}", f"{one['expected_error']:.3f}",
                f"{one['log_score']:.3f}",
            ])  # fmt: skip
    head = ["of", "training", "mean probability", "right", "calibration error", "log score"]
    return f"### Calibration of the class probabilities\n\n{table(head, rows)}"


def _missing(found: Mapping[str, Any]) -> str:
    names = {
        "tucker": "Bayesian Tucker",
        "tucker_without_sharing": "the same without shared columns",
        "additive": "additive person-plus-task mean",
    }
    rows = [[names[name], f"{error:.4f}"] for name, error in found["error"].items()]
    low, high = found["gain_interval"]
    return (
        "### Missing cells\n\n"
        f"Every one of {found['n']} cells left out and predicted by the others; mean over cells "
        f"of the root mean square over a cell's entries.\n\n{table(['model', 'error'], rows)}\n\n"
        f"The Tucker model's error is smaller by {found['gain']:.4f} (95 % interval {low:.4f} to "
        f"{high:.4f}), and smaller in {found['tucker_better_in']} cells; its 90 % intervals "
        f"cover {100 * found['coverage90']:.0f} %."
    )


def _dances(result: Mapping[str, Any]) -> str:
    pca, beats = result["pca"], result["beats"]
    rows = [
        [
            name, str(one["n"]), f"{one['keypose'][2]:.3f}", f"{one['uniform'][2]:.3f}",
            f"{one['keypose_error_cm']:.2f}", f"{one['uniform_error_cm']:.2f}",
        ]
        for name, one in pca["dances"].items()
    ]  # fmt: skip
    head = ["dance", "keyposes", "keypose PCA", "uniform PCA", "error, cm", "error uniform, cm"]
    gaps = [one["relative_difference"] for one in pca["probabilistic"].values()]
    pooled = ", ".join(
        f"{one['share']:.3f} in the {name} frame against {one['control']:.3f} after random shifts "
        f"(at most {one['control_largest']:.3f})"
        for name, one in beats["pooled"].items()
    )
    return (
        "### Dances\n\n"
        f"Share of beats with less energy near them than in the beat around them: {pooled}.\n\n"
        "Variance that three components cover, of keyposes and of as many uniformly sampled "
        "poses, and the error of all frames in their space:\n\n"
        f"{table(head, rows)}\n\n"
        f"Keyposes cover more in {pca['keypose_covers_more']} of {len(pca['dances'])} dances; the "
        f"frames between are nearer in {pca['keypose_error_smaller']}. The mode of probabilistic "
        f"PCA differs from the classical solution by at most {max(gaps):.0e} of it."
    )


def _music(found: Mapping[str, Any]) -> str:
    rows = [
        [
            name, f"{one['tempo_tracked']:.2f}", f"{one['tracked_from_even_ms']:.0f}",
            f"{one['tempo_grid']:.2f}", f"{one['matched']['at_grid']:.2f}",
            f"{one['matched']['control']:.2f}", f"{one['onsets']['at_grid']:.2f}",
            f"{one['onsets']['control']:.2f}", f"{one['onsets']['at_tracked']:.2f}",
        ]
        for name, one in found.items()
    ]  # fmt: skip
    head = [
        "music", "tempo tracked", "from even, ms", "tempo of the grid", "grid matched",
        "shifted grid matched", "onsets at grid", "at shifted grid", "at tracked beats",
    ]  # fmt: skip
    return (
        "Beats tracked in the music against the grid that the data's number of beats and span of "
        f"the music give:\n\n{table(head, rows)}\n\n"
        "Where the two tempi differ no grid of that tempo can fit this sound over a whole dance, "
        "and matches are at the level of shifted grids; the onsets tell which tempo is the "
        "music's."
    )


def _synthetic(found: Mapping[str, Any]) -> str:
    clean, program = found["clean"], found["generative"]
    rows = [
        [f"noise {row['noise']:g} rad", f"{row['precision']:.3f}", f"{row['recall']:.3f}"]
        for row in found["noise"]
    ] + [
        [f"drift {row['drift']:g} s", f"{row['precision']:.3f}", f"{row['recall']:.3f}"]
        for row in found["drift"]
    ]
    sampled = [name for name, one in program.items() if isinstance(one, Mapping)]
    sites = [
        [name, *(f"{program[name][how][0]:.3f} ± {program[name][how][1]:.3f}"
                 for how in ("nuts", "emcee"))]
        for name in sampled
    ]  # fmt: skip
    return (
        "### Synthetic dances\n\n"
        f"Without noise precision is {clean['precision']:.3f} and recall {clean['recall']:.3f}.\n\n"
        f"{table(['dances', 'precision', 'recall'], rows)}\n\n"
        "The generative program's posterior by two samplers:\n\n"
        f"{table(['site', 'NUTS', 'emcee'], sites)}\n\n"
        f"Their means differ by at most {program['worst_difference_in_mcse']:.1f} Monte Carlo "
        "standard errors, the keyposes' probabilities by at most "
        f"{program['largest_difference_of_probabilities']:.3f}."
    )


if __name__ == "__main__":
    write_results("keypose", markdown, *sys.argv[1:])
