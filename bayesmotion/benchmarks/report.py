"""What was measured, as Markdown drawn from its JSON file.

``python -m bayesmotion.benchmarks.report docs/performance.md docs/results/bench.json``
writes it into the page's block.
"""

import sys
from collections.abc import Mapping
from typing import Any

from ..studies.tables import table, write_results


def markdown(result: Mapping[str, Any]) -> str:
    """Return the tables of what has been measured."""
    parts = []
    if machine := result.get("machine"):
        parts.append(
            f"{machine['cores']} cores ({machine['machine']}, {machine['system']}), Python "
            f"{machine['python']}; at the beginning {machine['load_a_core']:.1f} processes a core "
            "wanted to run. CPU seconds of one thread, medians of "
            f"{result['settings']['repeats']} runs."
        )
    if dense := result.get("value_and_grad"):
        rows = [
            [f"{name}: {' x '.join(map(str, result['settings']['dense'][name]))}",
             f"{one['ratio']:.2f}", f"{1e3 * one['bayesmotion']:.1f}", f"{1e3 * one['floor']:.1f}"]
            for name, one in dense.items()
        ]  # fmt: skip
        parts.append(table(["points x outputs", "ratio to the floor", "ms", "floor, ms"], rows))
    if followed := result.get("online"):
        rows = [
            [str(result["settings"]["followed"][name]), f"{one['ms']:.0f}",
             f"{one['ms_after_few']:.0f}"]
            for name, one in followed.items()
        ]  # fmt: skip
        one = next(iter(followed.values()))
        frames = (f"ms a frame after {one[name]} frames" for name in ("frames", "frames_few"))
        parts.append(table(["draws of the fit that a clip is followed by", *frames], rows))
    if start := result.get("startup"):
        rows = [[name.replace("_", " "), f"{cpu:.2f}"] for name, cpu in start.items()]
        parts.append(table(["start", "CPU s"], rows))
    return "\n\n".join(parts)


if __name__ == "__main__":
    write_results("bench", markdown, *sys.argv[1:])
