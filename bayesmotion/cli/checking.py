"""The command ``check``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .. import console
from .outputs import Json, tell_saved

if TYPE_CHECKING:
    from ..motion.quality.findings import Finding


def check(
    files: Annotated[
        list[Path], typer.Argument(help="Recordings: .amc, .bvh, .c3d or a saved .nc.")
    ],
    json_file: Json = None,
) -> None:
    """Look recordings over: rest poses, jumps, frozen stretches, feet below the floor.

    Tells what was found and which frames to drop. The exit code is 1 if anything was found.
    """
    from ..files import write_json
    from ..motion.io.reading import read
    from ..motion.io.recordings import told
    from ..motion.quality.check import check as findings_of

    count, rows = 0, []
    for path in files:
        findings = findings_of(read(path))
        count += len(findings)
        rows.append({"file": str(path), "findings": [_plain(finding) for finding in findings]})
        if not findings:
            console.say(f"{path}: nothing found")
        for finding in findings:
            console.say(f"{path}: {told(finding)}")
    if json_file is not None:
        write_json(json_file, {"found": count, "files": rows})
        tell_saved(json_file)
    if count:
        raise typer.Exit(1)


def _plain(finding: "Finding") -> dict[str, object]:
    """Return a finding as plain values, with the frames to drop as they are counted from 0."""
    return {"clip": finding.clip, "kind": finding.kind, "sentence": finding.sentence,
            "drop": [int(frame) for frame in finding.drop]}  # fmt: skip
