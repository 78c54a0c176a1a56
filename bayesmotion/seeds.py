"""Seeds: what random numbers of every library here can be made of."""

from .errors import InputError

MAX_SEED = 2**32 - 1


def require_seed(seed: int) -> int:
    """Return a seed that can be used.

    Raises
    ------
    InputError
        If it is negative or has more than 32 bits.

    Examples
    --------
    >>> require_seed(7)
    7
    """
    if not 0 <= seed <= MAX_SEED:
        raise InputError(f"seed {seed}", "it is out of range", f"Give one of 0 to {MAX_SEED}")
    return seed
