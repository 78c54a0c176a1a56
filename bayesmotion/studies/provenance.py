"""What results were made with: the commit of the code, and versions of packages."""

import json
import subprocess
from pathlib import Path
from typing import Any

from ..inference.results import versions


def provenance() -> dict[str, Any]:
    """Return ``commit`` (with ``-dirty`` where files were changed, None outside a checkout)
    and ``versions`` of packages by name.
    """  # fmt: skip
    return {"commit": _commit(Path(__file__).parent), "versions": json.loads(versions())}


def _commit(folder: Path) -> str | None:
    words = ["git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=40",
             "--exclude=*"]  # fmt: skip
    try:
        found = subprocess.run(words, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return None
    return found.stdout.strip() if found.returncode == 0 else None
