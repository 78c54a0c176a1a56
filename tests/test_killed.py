"""Runs that are killed at any moment: the same draws after ``resume``, and no half files.

One is killed once with every run of the tests; all of them as often as one likes with
``pytest tests/test_killed.py --kills 4``.
"""

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

import bayesmotion as bm

CHILD = textwrap.dedent("""
    import sys, time, warnings
    import bayesmotion as bm
    from bayesmotion import search_state

    search_state.SECONDS = 0.0
    warnings.simplefilter("ignore", bm.MotionWarning)
    name, out = sys.argv[1:3]
    model, recordings = bm.example(name)
    if name == "gait_pose":
        model = type(model)(surface=bm.Torus())

    def progress(done, best):
        print("step", flush=True)
        time.sleep(0.1)

    bm.fit(model, recordings, method={method}, seed=3, checkpoint=out + ".part", resume=True,
           progress=progress).save(out)
""")
RUNS = {
    "mixture_ppca": "bm.EM(max_steps=30, tolerance=0.0)",
    "relevance_vectors": "bm.NUTS(draws=40, warmup=40, chains=2, max_tree_depth=4)",
    "voxel_pose": "bm.EM(max_steps=20, tolerance=0.0)",
    "voice_puppetry": "bm.EM(max_steps=20, tolerance=0.0)",
    "gait_pose": "bm.LocalLearning(sweeps=400)",
    "motion_tensor": "bm.NUTS(draws=40, warmup=40, chains=2, max_tree_depth=4)",
    "multifactor": "bm.NUTS(draws=40, warmup=40, chains=2, max_tree_depth=4)",
    "keyposes": "bm.Ensemble(draws=50, warmup=60, steps=60)",
}
ALWAYS = "mixture_ppca"


def started(name: str, out: Path) -> subprocess.Popen[str]:
    """Start a run in a process of its own."""
    program = CHILD.format(method=RUNS[name])
    command = [sys.executable, "-c", program, name, str(out)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ
    )


def killed(child: subprocess.Popen[str], after: float) -> bool:
    """Kill a run some seconds after its first step; tell whether it was still running."""
    assert child.stdout is not None
    begun = child.stdout.readline()
    time.sleep(after)
    running = child.poll() is None
    child.send_signal(signal.SIGKILL)
    _, told = child.communicate()
    # What had all its draws before takes no step.
    assert begun == "step\n" or child.returncode == 0, told
    return running


@pytest.mark.parametrize("name", list(RUNS))
def test_killed_runs_go_on_with_the_same_draws(name, tmp_path, kills, capfd):
    if kills == 1 and name != ALWAYS:
        pytest.skip("killed with --kills 2 or more")
    whole, random, count = started(name, tmp_path / "whole.nc"), np.random.default_rng(5), 0
    out = tmp_path / "fit.nc"
    for _ in range(kills):
        count += killed(started(name, out), random.uniform(0.0, 1.5))
        left = {path.name for path in tmp_path.iterdir() if "fit.nc" in path.name}
        # A file that was being written when the process died is hidden, and never read.
        assert {path for path in left if not path.startswith(".")} <= {"fit.nc", "fit.nc.part"}
    for child in (whole, started(name, out)):
        _, told = child.communicate()
        assert child.returncode == 0, told
    one, other = bm.load(tmp_path / "whole.nc").tree, bm.load(out).tree
    for site, values in one["posterior"].data_vars.items():
        np.testing.assert_array_equal(other["posterior"][site].values, values.values)
    assert count > 0
    with capfd.disabled():
        print(f"{name}: {count} of {kills} kills met a running process; the same draws")
