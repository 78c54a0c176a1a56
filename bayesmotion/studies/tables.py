"""Results written into Markdown pages, between two marks that no reader sees."""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..files import replacing


def write_block(path: str | Path, name: str, text: str) -> None:
    """Replace what stands between ``<!-- results:name -->`` and ``<!-- /results -->``.

    Parameters
    ----------
    path
        A Markdown page that has the two marks, in UTF-8.
    name
        Which results.
    text
        What is to stand there.

    Raises
    ------
    InputError
        If the page does not have exactly one such pair of marks.
    """
    path = Path(path)
    page = path.read_text(encoding="utf-8")
    start, end = f"<!-- results:{name} -->", "<!-- /results -->"
    pattern = re.compile(f"{re.escape(start)}.*?{re.escape(end)}", re.DOTALL)
    if len(pattern.findall(page)) != 1 or page.count(start) != 1:
        raise InputError(
            path, f"it has not exactly one block {name!r}", f"Write {start} and {end} into it"
        )
    block = f"{start}\n{text.strip()}\n{end}" if text.strip() else f"{start}\n{end}"
    with replacing(path) as temporary:
        temporary.write_text(pattern.sub(lambda _: block, page), encoding="utf-8")


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Give a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def page_block(markdown: Callable[[Any], str], result: Mapping[str, Any]) -> str:
    """Return what stands on a page: the results as `markdown` tells them, and their origin."""
    if not (text := markdown(result)):
        return ""
    if "made_with" in result:
        commits = ", ".join(str(commit) for commit in result["made_with"]["commits"])
        made = (
            f"Made with commit {commits}; settings, versions of packages and hashes of the data "
            "stand in the file of results."
        )
    else:
        made = (
            "Made with an earlier version of this code, in whose words the settings stand in the "
            "file of results."
        )
    return f"{text}\n\n{made}"


def write_results(
    name: str, markdown: Callable[[Any], str], page: str | Path, results: str | Path
) -> None:
    """Write the results of a study's JSON file, as `markdown` tells them, into its page's block."""
    found = json.loads(Path(results).read_text(encoding="utf-8"))
    write_block(page, name, page_block(markdown, found))
