"""How numbers are computed: in double precision, by one BLAS thread, and compiled once.

Set before JAX is imported, so that importing the package costs next to nothing.
"""

import os
import sys
from pathlib import Path

# Bytes of compiled programs that are kept in the user's cache folder, those used last.
KEPT = 2**31


def one_blas_thread() -> None:
    """Let BLAS work in one thread, unless `OPENBLAS_NUM_THREADS` says otherwise.

    The covariance matrices here have hundreds of rows, where a second thread gains little; but
    on a busy machine waiting threads spin, and one evaluation has been seen to take fifteen
    times as long.
    """
    if "OPENBLAS_NUM_THREADS" in os.environ:
        return
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    if "numpy" in sys.modules:
        # Libraries that are loaded already do not look at it any more, and draws would depend
        # on what was imported first.
        from threadpoolctl import threadpool_limits

        threadpool_limits(limits=1, user_api="blas")


def double_precision() -> None:
    """Let JAX compute in double precision.

    The kernel matrices of smooth motion have condition numbers far above 1e7.
    """
    _set("jax_enable_x64", True)


def keep_programs(folder: Path | None) -> None:
    """Keep compiled programs in a folder, so that the next process need not compile them.

    Whoever sets `JAX_COMPILATION_CACHE_DIR` keeps their folder; an empty one keeps nothing.

    Parameters
    ----------
    folder
        Made where it is not there. Where it cannot be, or None, programs are compiled anew.
    """
    if folder is None or "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    if "jax" in sys.modules and sys.modules["jax"].config.jax_compilation_cache_dir:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if os.access(folder, os.W_OK):
        _set("jax_compilation_cache_dir", str(folder))
        _set("jax_compilation_cache_max_size", KEPT)
        # Most programs are small, and there are many.
        _set("jax_persistent_cache_min_compile_time_secs", 0)


def _set(name: str, value: bool | int | str) -> None:
    """Set one of JAX's settings, whether it has been imported already or not."""
    os.environ[name.upper()] = str(value)
    if "jax" in sys.modules:
        sys.modules["jax"].config.update(name, value)
