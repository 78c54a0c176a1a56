"""Ctrl-C, while something computes that does not look at signals."""

import signal
import subprocess
import sys
import textwrap
import time

DEAF = """
    import time
    from bayesmotion.cli.interrupting import answering_interrupts

    with answering_interrupts("stopped\\n", 130, grace=0.2):
        while True:
            try:
                print("ready", flush=True)
                time.sleep(60)
            except KeyboardInterrupt:
                {answer}
"""


def interrupted(answer: str) -> tuple[int, str, float]:
    program = textwrap.dedent(DEAF.format(answer=answer))
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
    code, told, seconds = interrupted("pass")
    assert (code, told) == (130, "stopped\n")
    assert seconds < 20


def test_what_answers_ends_by_itself():
    code, told, _ = interrupted("raise SystemExit(7)")
    assert (code, told) == (7, "")
