"""What importing the package does, and that the tests check what they say they check."""

import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import TypeCheckError

import bayesmotion
from bayesmotion.gp.linalg import cholesky
from bayesmotion.motion import write_bvh
from bayesmotion.motion.features import continuous
from bayesmotion.motion.synthetic.walkers import synthetic_walkers


def test_importing_everything_makes_no_arrays():
    """Arrays made at import would start a device and hold its memory."""
    program = """
        import importlib, pkgutil
        import jax
        import bayesmotion

        names = [m.name for m in pkgutil.walk_packages(bayesmotion.__path__, "bayesmotion.")]
        for name in names:
            if not name.endswith("__main__"):
                importlib.import_module(name)
        assert "bayesmotion.models.multifactor" in names, names
        assert jax.live_arrays() == [], jax.live_arrays()
        assert jax.config.jax_enable_x64
    """
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr


def _python(program, **environment):
    kept = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True,
        env=kept | environment,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_importing_the_package_imports_neither_jax_nor_numpy(tmp_path):
    program = """
        import sys
        import bayesmotion
        assert not {"jax", "numpy", "xarray"} & set(sys.modules), sorted(sys.modules)
        import jax.numpy as jnp
        assert jnp.ones(1).dtype == "float64"
    """
    _python(program, XDG_CACHE_HOME=str(tmp_path))


HEAVY = ("jax", "numpyro", "scipy.signal", "scipy.stats", "sklearn", "matplotlib", "arviz")


def test_reading_and_checking_a_recording_imports_neither_jax_nor_statistics(tmp_path):
    walk = synthetic_walkers(["ann"], ["walk"], seconds=1.0, frame_rate=30.0)
    write_bvh(walk, tmp_path / "walk.bvh")
    program = f"""
        import sys
        import bayesmotion as bm
        from bayesmotion.cli import app

        bm.check(bm.read({str(tmp_path / "walk.bvh")!r}))
        app(["check", {str(tmp_path / "walk.bvh")!r}], standalone_mode=False)
        found = [name for name in {HEAVY} if name in sys.modules]
        assert not found, found
        # What is made of JAX is there as well.
        assert bm.read.__module__ == "bayesmotion.motion.io.reading"
        assert sys.modules["bayesmotion.motion"].forward.__name__ == "forward"
        assert "jax" in sys.modules
    """
    assert "nothing found" in _python(program)


def test_a_fit_that_is_not_there_is_refused_before_anything_is_imported():
    program = f"""
        import sys
        from bayesmotion.cli import app

        try:
            app(["forecast", "nosuch.nc", "nosuch.amc"])
        except SystemExit as ended:
            assert ended.code == 2
        found = [name for name in ("numpy", "xarray", *{HEAVY}) if name in sys.modules]
        assert not found, found
    """
    _python(program)


@pytest.mark.parametrize("first", ["bayesmotion", "jax"])
def test_what_was_compiled_is_kept_for_the_next_process(tmp_path, first):
    program = f"""
        import {first}
        import bayesmotion
        import jax
        jax.jit(lambda x: x + 1)(1.0)
    """
    _python(program, XDG_CACHE_HOME=str(tmp_path))
    assert list((tmp_path / "bayesmotion" / "programs").glob("jit__lambda*"))
    own = tmp_path / "own"
    _python(program, XDG_CACHE_HOME=str(tmp_path / "no"), JAX_COMPILATION_CACHE_DIR=str(own))
    assert not (tmp_path / "no").exists()


def test_a_cache_folder_that_cannot_be_made_is_done_without(tmp_path):
    (tmp_path / "file").write_text("")
    program = """
        import warnings
        warnings.simplefilter("error")
        import bayesmotion, jax
        print(jax.jit(lambda x: x + 1)(1.0), jax.config.jax_compilation_cache_dir)
    """
    assert _python(program, XDG_CACHE_HOME=str(tmp_path / "file")) == "2.0 None\n"


def test_numbers_are_double_precision():
    assert jnp.ones(1).dtype == np.float64
    assert jax.config.jax_enable_x64


def test_shapes_and_types_are_checked_in_these_tests():
    with pytest.raises(TypeCheckError):
        cholesky(jnp.ones((2, 3)))
    with pytest.raises(TypeCheckError):
        cholesky(jnp.ones((2, 2), dtype=int))
    with pytest.raises(TypeCheckError):
        continuous(np.ones((2, 4)))
    assert bayesmotion.__version__


def test_numpyro_is_whole_when_arviz_came_first():
    """ArviZ leaves a stand-in for NumPyro, which a submodule imported first would load twice."""
    program = """
        import arviz
        import bayesmotion.evaluate.compare
        import numpyro

        assert numpyro.distributions.distribution.Unit
    """
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr


def test_no_module_begins_with_a_part_of_numpyro():
    for path in Path(bayesmotion.__path__[0]).rglob("*.py"):
        first = re.search(r"^(?:from|import) (numpyro\S*)(.*)$", path.read_text(), re.MULTILINE)
        if first is not None:
            assert first[1] == "numpyro", f"{path.name}: {first[0]}"


@pytest.mark.parametrize("first", ["", "import numpy.linalg, scipy.linalg"])
def test_linear_algebra_has_one_thread_whatever_was_imported_first(first: str):
    """Draws depend on the number of threads: sums are rounded in another order."""
    program = f"""
        {first}
        import bayesmotion, numpy.linalg, scipy.linalg
        from threadpoolctl import threadpool_info

        pools = [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]
        assert pools, "there is no BLAS"
        assert set(pools) == {{1}}, pools
    """
    given = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, env=given
    )
    assert run.returncode == 0, run.stderr
