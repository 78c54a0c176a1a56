"""The command ``check``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .. import console
from ..errors import InputError
from .app import BAD_INPUT, Body, FrameRate
from .outputs import Json, tell_saved

if TYPE_CHECKING:
    from ..motion.quality.findings import Finding

FOUND = 1


def check(
    files: Annotated[
        list[Path],
        typer.Argument(help="Recordings: .amc, .bvh, .mot, .npz, .c3d, .trc or a saved .nc."),
    ],
    json_file: Json = None,
    frame_rate: FrameRate = None,
    skeleton: Body = None,
) -> None:
    """Look recordings over: rest poses, jumps, frozen stretches, feet below the floor.

    Tells what was found and which frames to drop, file by file, and of several files a table
    at the end. The exit code is 1 if anything was found, 2 if a file cannot be read.
    """
    from ..files import write_json
    from ..motion.dataset import clips
    from ..motion.io.reading import read
    from ..motion.io.recordings import given, told
    from ..motion.quality.check import check as findings_of

    table, rows, code = [], [], 0
    for path in files:
        try:
            motion = read(path, **given(frame_rate=frame_rate, skeleton=skeleton))
        except InputError as reason:
            console.error(reason)
            table.append((path, None, None, None, "refused"))
            rows.append({"file": str(path), "refused": str(reason)})
            code = BAD_INPUT
            continue
        findings = findings_of(motion)
        code = max(code, FOUND if findings else 0)
        rows.append({"file": str(path), "findings": [_plain(finding) for finding in findings]})
        if not findings:
            console.say(f"{path}: nothing found")
        for finding in findings:
            console.say(f"{path}: {told(finding)}")
        rate, frames = float(motion.attrs["frame_rate"]), motion.sizes["frame"]
        kinds = ", ".join(dict.fromkeys(finding.kind for finding in findings))
        table.append((path, len(clips(motion)), frames, f"{rate:g}", kinds or "nothing found"))
    if len(files) > 1:
        console.table(
            f"{len(files)} files", ["file", "clips", "frames", "frames a second", "found"], table
        )
    if json_file is not None:
        found = sum(len(row.get("findings", ())) for row in rows)
        write_json(json_file, {"found": found, "files": rows})
        tell_saved(json_file)
    if code:
        raise typer.Exit(code)


def _plain(finding: "Finding") -> dict[str, object]:
    """Return a finding as plain values, with the frames to drop as they are counted from 0."""
    return {"clip": finding.clip, "kind": finding.kind, "sentence": finding.sentence,
            "drop": [int(frame) for frame in finding.drop]}  # fmt: skip
