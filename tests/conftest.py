"""Strict tests: shapes are checked at run time, real data is found or its absence explained."""

import os
import sys
from pathlib import Path

import pytest
from jaxtyping import install_import_hook

# Before anything of the package is imported, so that every annotated function is checked.
# The hook works from this call on; it would end if it were used as a context manager.
assert "bayesmotion" not in sys.modules
install_import_hook("bayesmotion", "beartype.beartype")


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Folder of the public recordings; tests that use it carry the marker `real_data`."""
    root = os.environ.get("BAYESMOTION_DATA")
    if not root or not Path(root).is_dir():
        pytest.skip("real recordings are needed: set BAYESMOTION_DATA to their folder")
    return Path(root)
