"""How much faster local learning is than full learning, and what a step costs."""

import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from scipy.spatial import KDTree

from ...distributions.topology import Surface, topology_of
from ...inference.density import ProgramDensity, real_values
from ...inference.optimisation.optimise import maximise, stack
from ...models.gait_pose import SCALES, Around, GaitPose, Torus
from ...models.gait_pose import local_learning as local

SWEEPS = (5, 20, 80, 160, 320)
STEPS = 240
STEP_GAITS = {1800: 20, 19980: 222}
TIMED, FEATURES = 5, 54


def learning_plan() -> dict[str, Any]:
    """The settings of this part of the study."""
    return {
        "sweeps": list(SWEEPS),
        "steps": STEPS,
        "gaits": list(STEP_GAITS.values()),
        "timed": TIMED,
        "features": FEATURES,
    }


def compare_learning(motion: xr.Dataset, sigma: float, seed: int) -> dict[str, Any]:
    """Seconds that both ways of learning take, and the log density of all points they come to.

    Compilation is not counted for either: both are called once before.
    """
    around = Torus(sigma)
    model = GaitPose(around, SCALES)
    training = model.prepare(motion)
    data, density = training.data, ProgramDensity(model)
    start = model.initial_values(training, seed, 1)[0]
    evaluate = jax.jit(lambda values: density(density.real(values, data), data))

    def learn(sweeps: int) -> tuple[float, float]:
        began = time.perf_counter()
        values = local.learn_on_patches(around, *data, start, seed=seed, sweeps=sweeps).values()
        return time.perf_counter() - began, float(evaluate(values))

    learn(1)
    by_patches = [[float(sweeps), *learn(sweeps)] for sweeps in SWEEPS]
    first = stack([real_values(density, start, data)])
    maximise(density, first, data, max_steps=1)
    trace: list[list[float]] = []
    began = time.perf_counter()
    maximise(
        density, first, data, max_steps=STEPS,
        progress=lambda done, best: trace.append([float(done), time.perf_counter() - began, best]),
    )  # fmt: skip
    return {"local": by_patches, "full": trace, **faster(by_patches, trace)}


def faster(by_patches: list[list[float]], trace: list[list[float]]) -> dict[str, Any]:
    """How many times longer full learning takes to the same log density within 1 %.

    Once for every number of sweeps, to what they come to (None where full learning did not
    come so far), and once to what full learning comes to in the end (None where no number of
    sweeps does).
    """

    def seconds(steps: list[list[float]], goal: float) -> float | None:
        there = [at for _, at, reached in steps if reached >= goal - 0.01 * abs(goal)]
        return there[0] if there else None

    ratios = {}
    for sweeps, took, reached in by_patches:
        full = seconds(trace, reached)
        ratios[str(int(sweeps))] = None if full is None else full / took
    last = trace[-1][2]
    local_seconds, full = seconds(by_patches, last), seconds(trace, last)
    to_last = None if local_seconds is None or full is None else full / local_seconds
    return {
        "full_over_local": ratios,
        "full_over_local_to_last": to_last,
        "full_last": last,
        "full_seconds": trace[-1][1],
    }


def step_cost(seed: int) -> dict[str, float]:
    """Milliseconds of a local step on surfaces of different size, the fastest of several blocks."""
    random = np.random.default_rng(seed)
    hyper = {name: np.array(1.0) for name in local.HYPER}
    out = {}
    for points, gaits in STEP_GAITS.items():
        surface = Surface("torus", 30, gaits, SCALES)
        t = surface.points()
        y = np.sin(t @ random.normal(size=(3, FEATURES)))
        data = (jnp.asarray(y), jax.tree.map(jnp.asarray, topology_of(surface)))
        references = random.choice(len(t), local.BLOCK, replace=False)
        patches = KDTree(t).query(t[references], local.PATCH)[1]
        rates = np.full(local.BLOCK, 0.01)
        learning = local.begin({"x": t, **hyper})
        times = []
        for _ in range(TIMED + 1):
            began = time.perf_counter()
            learning, _ = local.take_steps(Around(), learning, data, patches, rates)
            learning.x.block_until_ready()
            times.append(time.perf_counter() - began)
        # The first call compiles.
        out[str(points)] = 1000.0 * min(times[1:]) / local.BLOCK
    return out
