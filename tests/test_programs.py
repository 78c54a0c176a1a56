"""Programs run one at a time, in double precision."""

from concurrent.futures import ThreadPoolExecutor

import jax
import numpyro
import pytest
import xarray as xr
from numpyro import distributions as dist
from numpyro import handlers

import bayesmotion as bm
from bayesmotion.programs import one_at_a_time


@one_at_a_time
def sites(name: str, count: int = 300) -> set[str]:
    """Run a program of so many sites; return the names it was found to have."""

    def program() -> None:
        for k in range(count):
            numpyro.sample(f"{name}{k}", dist.Normal())

    return {n[0] for n in handlers.trace(handlers.seed(program, 0)).get_trace()}


def test_programs_in_threads_do_not_see_each_other():
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(sites, "abcdabcd")) == [set(name) for name in "abcdabcd"]


def test_single_precision_is_noticed():
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(bm.InputError, match="jax_enable_x64: it was switched off"):
            bm.fit(bm.Multifactor(), xr.Dataset())
    finally:
        jax.config.update("jax_enable_x64", True)


def test_seeds_that_are_none_are_refused():
    for seed in (-1, 2**32):
        with pytest.raises(bm.InputError, match="out of range"):
            bm.fit(bm.Multifactor(), xr.Dataset(), seed=seed)
