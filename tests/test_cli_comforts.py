"""Comforts of the command line: versions, signs of life."""

import subprocess
import sys
import time

import pytest

from bayesmotion import __version__, console


@pytest.mark.parametrize("words", [["--version"], ["-h"], ["forecast", "-h"]])
def test_the_package_runs_as_a_module(words):
    run = subprocess.run(
        [sys.executable, "-m", "bayesmotion", *words], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    told = f"bayesmotion {__version__}\n" if words == ["--version"] else "Usage: "
    assert told in run.stdout


def test_where_no_terminal_is_a_line_tells_how_far_it_is(monkeypatch, capsys):
    monkeypatch.setattr(console, "EVERY", 0.02)
    with console.progress("map", 100) as progress:
        progress(40, -12.34)
        time.sleep(0.15)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) >= 2
    assert lines[-1].startswith("bayesmotion: map: 40/100 steps after 0 s, log density -12.3")


def test_nothing_is_told_of_what_is_done_at_once(capsys):
    with console.progress("map", 100) as progress:
        progress(100, 1.0)
    assert capsys.readouterr().err == ""
