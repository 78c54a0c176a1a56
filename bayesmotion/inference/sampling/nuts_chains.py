"""Chains of the no-U-turn sampler that go on block by block, each a thread of its own.

JAX lets go of the interpreter while it computes. After every block the whole state can be
taken out, and put back in: a run goes on as one that was left alone, to the last bit on
the same machine.
"""

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import jax
import numpy as np
from jaxtyping import Array
from numpyro import infer  # noqa: F401 (the whole before a part of it)
from numpyro.infer.hmc import hmc

from ..draws import on_device
from .whitening import SampledDensity, SamplingProblem, Whitening

BLOCK = 20
TARGET_ACCEPT = 0.8

Mass = Literal["dense", "diagonal"]


@dataclass(frozen=True)
class Sampler:
    """NUTS on one target; equal samplers share a compilation.

    warmup
        Iterations in which step size and mass matrix are adapted.
    mass
        Whether the mass matrix adapted in z is dense.
    max_tree_depth
        A trajectory has at most 2^max_tree_depth - 1 leapfrog steps.
    """

    target: SampledDensity
    warmup: int
    mass: Mass
    max_tree_depth: int

    def begin(self, key: Array, z: Array, transform: Whitening, data: tuple) -> Any:
        """Give the state of a chain that begins at z (n,)."""
        return _compiled(self)[0](key, z, transform, data)

    def block(self, state: Any, transform: Whitening, data: tuple) -> tuple[Any, dict[str, Array]]:
        """Go on by `BLOCK` iterations; give the state, and points and figures (block, ...)."""
        return _compiled(self)[1](state, transform, data)


@lru_cache(maxsize=8)
def _compiled(sampler: Sampler) -> tuple[Any, Any]:
    """Compile how a chain begins and goes on by a block."""

    def potential(transform: Whitening, data: tuple) -> Any:
        return lambda z: -sampler.target(z, transform, data)

    init, move = hmc(potential_fn_gen=potential, algo="NUTS")

    def begin(key, z, transform, data):
        return init(
            z,
            num_warmup=sampler.warmup,
            dense_mass=sampler.mass == "dense",
            target_accept_prob=TARGET_ACCEPT,
            max_tree_depth=sampler.max_tree_depth,
            model_args=(transform, data),
            rng_key=key,
        )

    def step(state, transform, data):
        state = move(state, (transform, data), {})
        return state, {
            "z": state.z,
            "lp": -state.potential_energy,
            "energy": state.energy,
            "diverging": state.diverging,
            "n_steps": state.num_steps,
            "acceptance_rate": state.accept_prob,
            "step_size": state.adapt_state.step_size,
        }

    def block(state, transform, data):
        return jax.lax.scan(lambda s, _: step(s, transform, data), state, length=BLOCK)

    return jax.jit(begin), jax.jit(block)


class Chains:
    """Chains of a sampler that go on together, block by block.

    done
        Iterations so far.
    kept
        Points and figures after the warm-up, (chain, draws so far, ...).
    """

    def __init__(
        self, sampler: Sampler, problem: SamplingProblem, keys: Array, z: np.ndarray
    ) -> None:
        self._sampler, self._where = sampler, (problem.transform, problem.training.data)
        self._states = [
            sampler.begin(key, on_device(one), *self._where)
            for key, one in zip(keys, z, strict=True)
        ]
        self._threads = min(len(z), os.cpu_count() or 1)
        self.done = 0
        self.kept: dict[str, np.ndarray] = {}

    def advance(self) -> None:
        """Go on by a block in every chain."""

        def one(state: Any) -> Any:
            return jax.block_until_ready(self._sampler.block(state, *self._where))

        with ThreadPoolExecutor(self._threads) as pool:
            moved = list(pool.map(one, self._states))
        self._states = [state for state, _ in moved]
        drop = min(max(self._sampler.warmup - self.done, 0), BLOCK)
        self.done += BLOCK
        for name in moved[0][1]:
            new = np.stack([np.asarray(figures[name]) for _, figures in moved])[:, drop:]
            past = self.kept.get(name)
            self.kept[name] = new if past is None else np.concatenate([past, new], axis=1)

    @property
    def best(self) -> float:
        """The best log density of where the chains are."""
        return float(-min(state.potential_energy for state in self._states))

    def arrays(self) -> dict[str, np.ndarray]:
        """Give everything that is needed to go on from here."""
        leaves = [jax.tree.leaves(state) for state in self._states]
        states = {
            f"state_{i}": np.stack(parts) for i, parts in enumerate(zip(*leaves, strict=True))
        }
        kept = {f"kept_{name}": value for name, value in self.kept.items()}
        return {"done": np.array(self.done), **states, **kept}

    def restore(self, arrays: Mapping[str, np.ndarray]) -> None:
        """Undo `arrays`."""
        for chain, state in enumerate(self._states):
            leaves, structure = jax.tree.flatten(state)
            saved = on_device([arrays[f"state_{i}"][chain] for i in range(len(leaves))])
            self._states[chain] = jax.tree.unflatten(structure, saved)
        self.done = int(arrays["done"])
        prefix = "kept_"
        self.kept = {n.removeprefix(prefix): v for n, v in arrays.items() if n.startswith(prefix)}
