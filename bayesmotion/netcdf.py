"""netCDF files: written whole, with a hash of what is in them; read as data from strangers.

Whatever a file claims, reading it ends: a child process looks it over first (`vetting`), and
values that were changed since they were written are refused.
"""

import hashlib
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from . import vetting
from .errors import InputError
from .files import require_file, write_bytes

HASH = "contents_sha256"
# The child may need this long where nothing is wrong, seconds for any file and for a gigabyte.
SECONDS, SECONDS_A_GIGABYTE = 120.0, 120.0


def write_netcdf(path: str | Path, data: xr.Dataset | xr.DataTree) -> None:
    """Write a data set or tree as netCDF, with a hash of its values and attributes.

    It is made in memory: where a disk is full HDF5 would end the process when it closes the
    file.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    tree = xr.DataTree(data) if isinstance(data, xr.Dataset) else data.copy()
    tree.attrs = {**tree.attrs, HASH: contents_hash(tree)}
    stored = tree.to_netcdf(engine="h5netcdf")
    assert isinstance(stored, memoryview)
    # A copy: whoever keeps the error of a full disk would keep the buffer from being closed.
    content = bytes(stored)
    del stored
    write_bytes(path, content)


def read_netcdf(path: str | Path, mend: str) -> xr.DataTree:
    """Read a netCDF file that anybody may have written, whole.

    Parameters
    ----------
    path
        The file.
    mend
        What to do where it cannot be read, for the error.

    Returns
    -------
    Its groups and variables, in memory, without how they were stored.

    Raises
    ------
    InputError
        If it is not there, is no netCDF, points outside itself, claims to be larger than it
        can be, cannot be read to the end, or holds other values than were written.
    """
    path = Path(path)
    require_file(path)
    wrong = _vetted(path)
    if wrong is None:
        try:
            with xr.open_datatree(path, engine="h5netcdf", decode_times=False) as stored:
                tree = stored.load()
        # All that xarray and its backend raise of files that are not as they write them.
        except (
            OSError, ValueError, TypeError, LookupError, AttributeError, RuntimeError,
            ArithmeticError, AssertionError, NotImplementedError,
        ) as error:  # fmt: skip
            wrong = str(error).split("\n")[0]
    if wrong is not None:
        raise InputError(path, f"it cannot be read as netCDF ({wrong})", mend)
    for node in tree.subtree:
        for variable in node.variables.values():
            # A text of five letters must not stay cut to five when it is written again.
            variable.encoding = {}
        node.encoding = {}
    written = tree.attrs.pop(HASH, None)
    if written is not None and written != contents_hash(tree):
        raise InputError(
            path, "its values are not those that were written: it is damaged or was changed",
            f"{mend}; if the change was meant, remove the attribute {HASH}",
        )  # fmt: skip
    return tree


def contents_hash(tree: xr.DataTree) -> str:
    """Return the SHA-256 of all groups, variables, coordinates and attributes of a tree."""
    digest = hashlib.sha256()
    for node in sorted(tree.subtree, key=lambda node: node.path):
        data = node.to_dataset(inherit=False)
        shapes = sorted((str(name), v.dims) for name, v in data.variables.items())
        attrs = sorted((str(n), np.ravel(v).tolist()) for n, v in node.attrs.items() if n != HASH)
        digest.update(f"{node.path}{shapes}{attrs}{values_hash(data)}".encode())
    return digest.hexdigest()


def values_hash(data: xr.Dataset | np.ndarray) -> str:
    """Return the SHA-256 of an array, or of all variables and coordinates of a data set.

    Attributes do not count: they hold the history of how files were read.
    """
    digest = hashlib.sha256()
    named: dict[Any, Any] = {"": data} if isinstance(data, np.ndarray) else dict(data.variables)
    for name, array in sorted(named.items(), key=lambda item: str(item[0])):
        values = np.ascontiguousarray(array)
        numbers = values.dtype.kind in "fiub"
        digest.update(f"{name}{values.shape}".encode())
        digest.update(values.tobytes() if numbers else repr(values.tolist()).encode())
    return digest.hexdigest()


def _vetted(path: Path) -> str | None:
    """Return what is wrong with a file, None where a child process could read all of it.

    HDF5 runs for ever on some damages, and ends the process on others.
    """
    gigabytes = path.stat().st_size / 2**30
    # Without -P the child would take this package's modules for those of others.
    command = [sys.executable, "-P", vetting.__file__, str(path)]
    try:
        child = subprocess.run(
            command, capture_output=True, text=True, errors="replace", check=False,
            stdin=subprocess.DEVNULL, timeout=SECONDS + SECONDS_A_GIGABYTE * gigabytes,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "reading it does not end"
    if child.returncode in (0, vetting.FAULT):
        return child.stdout.strip() or None
    return "reading it breaks off: it is damaged"
