"""Packages that few need, which an extra of the installation brings."""

import importlib
from typing import Any

from .errors import InputError


def required(module: str, extra: str) -> Any:
    """Return a module that an extra installs.

    Raises
    ------
    InputError
        If it is not installed; the sentence says how to.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise InputError(
            f"the package {module.split('.')[0]!r}", "it is not installed",
            f"Install bayesmotion[{extra}], for example by uv pip install 'bayesmotion[{extra}]'",
        ) from error  # fmt: skip
