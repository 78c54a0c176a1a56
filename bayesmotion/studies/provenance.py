"""What results were made with: the commit of the code, versions of packages, and the data."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ..inference.results import versions
from ..netcdf import values_hash


def provenance(**data: xr.Dataset | np.ndarray) -> dict[str, Any]:
    """Say what results were made with.

    Parameters
    ----------
    data
        What was read, by the name it has in the results: data sets or arrays.

    Returns
    -------
    ``commit`` (with ``-dirty`` where files were changed, None outside a checkout), ``versions``
    of packages by name, and ``data``, the SHA-256 of every data set's values.
    """
    return {
        "commit": _commit(Path(__file__).parent),
        "versions": json.loads(versions()),
        "data": {name: values_hash(values) for name, values in data.items()},
    }


def _commit(folder: Path) -> str | None:
    words = ["git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=40",
             "--exclude=*"]  # fmt: skip
    try:
        found = subprocess.run(words, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return None
    return found.stdout.strip() if found.returncode == 0 else None
