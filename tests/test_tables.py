from pathlib import Path

import pytest

from bayesmotion import console
from bayesmotion.errors import InputError
from bayesmotion.studies.tables import write_block


def test_a_block_is_replaced_and_the_rest_stays(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- results:a -->\nold\n<!-- /results -->\nafter \\1\n")
    write_block(page, "a", "| new \\g<0> |")
    new = "before\n<!-- results:a -->\n| new \\g<0> |\n<!-- /results -->\nafter \\1\n"
    assert page.read_text() == new
    write_block(page, "a", "| new \\g<0> |")
    assert page.read_text() == new


@pytest.mark.parametrize("text", ["", "<!-- results:b -->\n<!-- /results -->\n"])
def test_a_page_without_the_block_is_refused(tmp_path: Path, text: str):
    page = tmp_path / "page.md"
    page.write_text(text)
    with pytest.raises(InputError, match="not exactly one block 'a'"):
        write_block(page, "a", "new")


def test_a_table_is_never_cut_in_a_pipe(capsys):
    console.table("wide", ["clip", *"abcdefgh"], [["x" * 90, *(["y" * 60] * 8)]])
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].count("y" * 60) == 8
    assert lines[-1].startswith("x" * 90)
