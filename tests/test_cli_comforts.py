"""Comforts of the command line: versions, signs of life, Ctrl-C."""

import os
import signal
import subprocess
import sys
import textwrap
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


def test_ctrl_c_ends_compiled_code_that_python_does_not_leave():
    program = """
        import jax, jax.numpy as jnp
        import bayesmotion
        from bayesmotion.cli import app, interrupting

        interrupting.SECONDS = 0.5

        @app.command()
        def slow():
            def step(i, x):
                return jnp.sin(x @ x)

            long = jax.jit(lambda x: jax.lax.fori_loop(0, 10**9, step, x))
            print("begun", flush=True)
            long(jnp.ones((64, 64))).block_until_ready()

        app(["slow"])
    """
    run = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(program)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert run.stdout is not None
    assert run.stdout.readline() == "begun\n"
    time.sleep(1.0)
    os.kill(run.pid, signal.SIGINT)
    try:
        _, told = run.communicate(timeout=20)
    finally:
        run.kill()
    assert run.returncode == 130
    assert told == "bayesmotion: interrupted; files that were there are as they were.\n"
