"""Reading NumPy's .npz files that strangers wrote: arrays of numbers and texts, never objects."""

import tokenize
import zipfile
import zlib
from collections.abc import Collection
from pathlib import Path

import numpy as np

from .errors import InputError

LARGEST = 2**30  # bytes of an array; an hour of AMASS poses at 120 frames a second has half
# What `zipfile` and `numpy.load` raise on damaged files: their headers are Python literals, and
# names, lengths and compression can say anything.
_BROKEN = (
    ValueError, TypeError, KeyError, EOFError, MemoryError, RuntimeError, SyntaxError,
    NotImplementedError, tokenize.TokenError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


def read_arrays(
    path: str | Path, what: str, mend: str, *, names: Collection[str] | None = None
) -> dict[str, np.ndarray]:
    """Read the arrays of an .npz file; pickled objects are never loaded.

    Parameters
    ----------
    path
        The file.
    what
        What it should be, for the error: ``"a portrait"``.
    mend
        What a user can do about a file that is none.
    names
        Of the arrays that are read where they are there; by default all.

    Raises
    ------
    InputError
        If it is not there, is damaged, or an array is larger than 1 GB.

    Examples
    --------
    >>> from bayesmotion.npz import read_arrays
    >>> read_arrays("walk_poses.npz", "AMASS", "Give one of AMASS")  # doctest: +SKIP
    """
    found = {}
    try:
        with zipfile.ZipFile(path) as archive:
            for entry in archive.namelist():
                name = entry.removesuffix(".npy")
                if names is not None and name not in names:
                    continue
                if archive.getinfo(entry).file_size > LARGEST:
                    raise ValueError(f"{name} is larger than {LARGEST} bytes")
                with archive.open(entry) as content:
                    found[name] = np.lib.format.read_array(content, allow_pickle=False)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(path, f"it cannot be read ({reason})", "Check the path") from error
    except _BROKEN as error:
        raise InputError(path, f"it is no .npz file of {what} ({error})", mend) from error
    return found
