"""Ctrl-C, while something computes that does not look at signals."""

import os
import signal
import subprocess
import sys
import textwrap
import time

TOLD = (
    "bayesmotion: interrupted; files that were there are as they were. What keeps a state goes on "
    "with --resume.\n"
)
DEAF = """
    import time
    from bayesmotion.cli import interrupting

    interrupting.SECONDS = {seconds}
    with interrupting.ended_when_interrupted():
        while True:
            try:
                print("ready", flush=True)
                time.sleep(60)
            except KeyboardInterrupt:
                {answer}
"""


def interrupted(answer: str, seconds: float) -> tuple[int, str, float]:
    program = textwrap.dedent(DEAF.format(answer=answer, seconds=seconds))
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None
        child.stdout.readline()
        begun = time.monotonic()
        child.send_signal(signal.SIGINT)
        _, told = child.communicate(timeout=60)
        return child.returncode, told, time.monotonic() - begun


def test_what_does_not_answer_is_ended():
    code, told, seconds = interrupted("pass", 0.2)
    assert (code, told) == (130, TOLD)
    assert seconds < 20


def test_what_answers_ends_by_itself():
    code, told, _ = interrupted("raise SystemExit(7)", 60.0)
    assert (code, told) == (7, "")
    code, told, _ = interrupted("raise", 60.0)
    assert (code, told) == (130, TOLD)


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
    assert told == TOLD
