"""One measurement in a process: ``python -m bayesmotion.benchmarks.measure N D REPEATS``.

It is the value and gradient of the log density of D outputs with one RBF kernel over N points in
three dimensions, by the points, length scale, noise and scales, against the LAPACK floor: Cholesky
factor, inverse (potri), K^-1 Y (symm) and Y Y^T (syrk), which nothing that factorises K does
without. A line of JSON says what was found.
"""

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.linalg import get_blas_funcs, get_lapack_funcs

from ..gp.kernels import rbf
from ..gp.matrix_normal import complete
from ..gp.matrix_normal import log_density as density_of


def seconds(*works: Callable[[], object], repeats: int) -> list[list[tuple[float, float]]]:
    """Return CPU and wall seconds of every work, done in turn so many times after a first."""
    found: list[list[tuple[float, float]]] = [[] for _ in works]
    for count in range(repeats + 1):
        for work, times in zip(works, found, strict=True):
            cpu, wall = time.process_time(), time.perf_counter()
            jax.block_until_ready(work())
            if count:
                times.append((time.process_time() - cpu, time.perf_counter() - wall))
    return found


def dense(n: int, d: int, repeats: int) -> dict[str, Any]:
    """Return CPU seconds of the floor and of value and gradient, and their ratio: medians."""
    random = np.random.default_rng(0)
    X, Y = jnp.asarray(random.normal(size=(n, 3))), random.normal(size=(n, d))
    K = np.asfortranarray(rbf("x").matrix({"x": X}, {"x": X}) + 0.1 * np.eye(n))
    outputs, missing = np.asfortranarray(Y), complete(n, d)

    potrf, potri = get_lapack_funcs(("potrf", "potri"), (K,))
    symm, syrk = get_blas_funcs(("symm", "syrk"), (K, outputs))

    def floor() -> object:
        inverse = potri(potrf(K, lower=1, clean=0)[0], lower=1, overwrite_c=1)[0]
        A = symm(1.0, inverse, outputs, lower=1)
        return syrk(-1.0, A, beta=float(d), c=inverse, lower=1, overwrite_c=1)

    def density(X: Array, length: Array, beta: Array, scale: Array, Y: Array) -> Array:
        K = rbf("x", length_scale=length).matrix({"x": X}, {"x": X}) + jnp.eye(n) / beta
        return density_of(Y, K, scale, missing)

    compiled = jax.jit(jax.value_and_grad(density, (0, 1, 2, 3)))
    at = (X, jnp.array(1.0), jnp.array(10.0), jnp.ones(d), jnp.asarray(Y))
    low, ours = (
        np.array(times) for times in seconds(floor, lambda: compiled(*at), repeats=repeats)
    )
    return {
        "floor": float(np.median(low[:, 0])),
        "bayesmotion": float(np.median(ours[:, 0])),
        "ratio": float(np.median(ours[:, 0] / low[:, 0])),
    }


if __name__ == "__main__":
    print(json.dumps(dense(*map(int, sys.argv[1:]))))
