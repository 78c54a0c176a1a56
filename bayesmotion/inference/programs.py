"""Compiled programs, and when to forget them.

JAX keeps every program that it compiled, each in some tens of memory mappings, of which Linux
gives a process 65,530. A process that fits model after model would come to their end, and die.
"""

from pathlib import Path

import jax

# Enough are left for what the largest fits compile.
MAPPINGS = 25_000
_MAPS = Path("/proc/self/maps")


def forget_programs(most: int = MAPPINGS) -> bool:
    """Forget all compiled programs where this process holds many memory mappings.

    What is called again is compiled again. `bayesmotion.fit` begins with this; long loops over
    fits that do not go through it call it themselves.

    Parameters
    ----------
    most
        Mappings up to which nothing is forgotten.

    Returns
    -------
    Whether programs were forgotten; never where the system does not tell of its mappings.
    """
    if not _MAPS.exists() or _MAPS.read_bytes().count(b"\n") <= most:
        return False
    jax.clear_caches()
    return True
