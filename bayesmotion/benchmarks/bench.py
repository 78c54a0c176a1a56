"""What values and gradients of densities, and starting, cost on this machine.

Each measurement is a process of its own (`measure`), in one thread, so that its memory and time
are nobody else's. CPU seconds; ratios to the LAPACK floor are of paired runs.
"""

import json
import os
import platform
import resource
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..studies.stages import Say, Stages

# Points and outputs of the dense densities.
DENSE = {"A": (314, 89), "B": (1800, 54)}
REPEATS = 7
PARTS = ("value_and_grad", "online", "startup")
# Draws of a fit that clips are followed by: the mode, and many.
FOLLOWED = {"mode": 1, "draws": 100}
STARTS = {
    "help": ("-m", "bayesmotion", "--help"),
    "no_such_file": ("-m", "bayesmotion", "check", "no-such-file.bvh"),
    "import": ("-c", "import bayesmotion"),
}
ONE_THREAD = {
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
}


def bench(
    out: Path,
    parts: Sequence[str] = PARTS,
    repeats: int = REPEATS,
    say: Say = print,
) -> dict[str, Any]:
    """Measure what is not yet in the file of results, and return all that is.

    Parameters
    ----------
    out
        The file of results, JSON.
    parts
        Of `PARTS`.
    repeats
        Runs that medians are of.
    say
        Called with a line after every measurement.
    """
    stages = Stages(out, plan(repeats), say)
    stages.do("machine", work=machine)
    if "value_and_grad" in parts:
        for name, size in DENSE.items():
            words = ("measure", *size, repeats)
            stages.do("value_and_grad", name, work=lambda w=words: measured(*w))
    if "online" in parts:
        for name, draws in FOLLOWED.items():
            words = ("online", draws, repeats)
            stages.do("online", name, work=lambda w=words: measured(*w))
    if "startup" in parts:
        for name, words in STARTS.items():
            stages.do("startup", name, work=lambda w=words: started(w, repeats))
    return stages.result


def plan(repeats: int = REPEATS) -> dict[str, Any]:
    """Return the settings of what is measured."""
    return {"dense": DENSE, "followed": FOLLOWED, "repeats": repeats}


def measured(module: str, *numbers: int) -> dict[str, Any]:
    """Return what a process of its own measures; see `measure` and `online`."""
    words = [sys.executable, "-m", f"{__package__}.{module}", *map(str, numbers)]
    found = subprocess.run(
        words, env={**os.environ, **ONE_THREAD}, stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(found.stdout)


def started(words: Sequence[str], repeats: int) -> float:
    """Return the median CPU seconds of a Python process, whatever it exits with."""
    times = []
    for _ in range(repeats):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *words], capture_output=True, check=False)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    return float(np.median(times))


def machine() -> dict[str, Any]:
    """Return what the processor is, how many there are, and how busy they were at the beginning."""
    cores = os.cpu_count() or 1
    return {
        "machine": platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
        "cores": cores,
        "load_a_core": os.getloadavg()[0] / cores,
    }
