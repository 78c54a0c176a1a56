"""The faces of the speech study as Markdown: real clips, and the synthetic talker."""

from collections.abc import Mapping
from typing import Any

from ..tables import table

NAMES = {
    "encoder": "the encoder itself, given the pictures",
    "still_face": "a face that does not move",
}
MEASURES = {
    "landmarks_px": "landmarks, px",
    "lips_px": "lips, px",
    "opening_correlation": "mouth's opening, correlation",
    "opening_peak_to_peak": "its peak to peak, of the truth's",
    "grey_levels": "texture, grey levels",
}


def faces_markdown(result: Mapping[str, Any], names: Mapping[str, str]) -> str:
    """Give the tables of the parts that are there.

    Parameters
    ----------
    result
        Of the study, with ``talker`` or ``grid`` or neither.
    names
        How models are called.
    """
    parts = []
    if talker := result.get("talker"):
        parts.append(
            f"The synthetic talker: {talker['training_frames']:,} frames to train, "
            f"{talker['test_frames']} to test, {talker['parameters']} parameters that keep "
            f"{min(talker['kept']):.1%} of the variance or more."
        )
        parts.append(_models(talker["models"], names, times=True))
    if grid := result.get("grid"):
        parts.append(
            f"Real faces, every clip's last frames by a model of its first "
            f"{grid['settings']['first_frames']}; searches start "
            f"{grid['settings']['displaced_px']:.0f} pixels away from the tracked landmarks."
        )
        parts.append(_clips(grid["clips"]))
        left = grid["left_out"]
        parts.append(
            f"The clip `{left['clip']}`, left out whole, from its sound: models learned from "
            f"{left['training_frames']} frames of the other clips."
        )
        parts.append(_models(left["models"], names, times=False))
    return "\n\n".join(parts)


def _models(rows: Mapping[str, Mapping[str, Any]], names: Mapping[str, str], *, times: bool) -> str:
    """Give a row a model."""
    called = {**names, **NAMES}
    measures = {**MEASURES, **({"times_encoder": "times the encoder's"} if times else {})}
    lines = [
        [called.get(name, name), *(_number(row.get(measure)) for measure in measures)]
        for name, row in rows.items()
    ]
    return table(["", *measures.values()], lines)


def _clips(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Give a row a clip: what its own appearance model makes of frames it has not seen."""
    head = [
        "clip", "parameters", "texture, grey levels", "by the mean face", "landmarks, px",
        "found by search, px", "searches that failed",
    ]  # fmt: skip
    lines = [
        [
            name, str(row["parameters"]), _number(row["grey_levels"]),
            _number(row["grey_levels_mean_face"]), _number(row["landmarks_px"]),
            _number(row["search_px"]), f"{row['search_failed']} of {row['frames']}",
        ]
        for name, row in rows.items()
    ]  # fmt: skip
    return table(head, lines)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"
