"""What commands write, checked before they do any work."""

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..files import Kind, check_outputs, held


def checked(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that refuses what it cannot write before it does anything.

    Outputs are the parameters with a `Kind` in their annotation, all other paths are inputs.
    No other process of the user may write the same file while the command runs.
    """
    signature = inspect.signature(command)
    kinds = {
        name: kind
        for name, parameter in signature.parameters.items()
        for kind in getattr(parameter.annotation, "__metadata__", ())
        if isinstance(kind, Kind)
    }

    @functools.wraps(command)
    def run(*args: Any, **options: Any) -> None:
        given = signature.bind(*args, **options).arguments
        outputs = [(given[name], kind) for name, kind in kinds.items() if given.get(name)]
        inputs = [
            path
            for name, value in given.items()
            if name not in kinds
            for path in (value if isinstance(value, list) else [value])
            if isinstance(path, Path)
        ]
        check_outputs(outputs, inputs)
        with held(path for path, _ in outputs):
            command(*args, **options)

    return run
