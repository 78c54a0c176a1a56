"""Settings as plain values for files, and back.

Settings are frozen dataclasses of numbers, texts, tuples and other such dataclasses. Where a
setting may be one of several classes, the plain form says which:

    Multifactor(content=GPDynamics(size=2))  ->  {"content": {"type": "GPDynamics", "size": 2}}

A setting that came later than files were written, and changes what a model does by default,
says in its field's metadata what held in the files that do not have it (`BEFORE`); where it holds,
files do not have it.
"""

import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

TYPE = "type"
BEFORE = "before"


def plain(value: Any) -> Any:
    """Return a setting as plain values: dataclasses as dictionaries, tuples as lists."""
    if is_dataclass(value) and not isinstance(value, type):
        kept = {field.name: getattr(value, field.name) for field in fields(value)}
        for field in fields(value):
            if BEFORE in field.metadata and kept[field.name] == field.metadata[BEFORE]:
                del kept[field.name]
        inside = {name: plain(one) for name, one in kept.items()}
        return {TYPE: type(value).__name__, **inside}
    if isinstance(value, tuple | list):
        return [plain(item) for item in value]
    return value


def restored(hint: Any, value: Any) -> Any:
    """Return the setting of a type that `plain` made plain.

    Raises
    ------
    KeyError, TypeError
        If the plain values are none of this type's.
    """
    if isinstance(value, Mapping):
        known = {kind.__name__: kind for kind in _classes(hint)}
        inside = dict(value)
        kind = known[inside.pop(TYPE)]
        return restored_class(kind, inside)
    if isinstance(value, list):
        items = [part for part in _union(hint) if get_origin(part) is tuple]
        item = get_args(items[0])[0] if items else Any
        return tuple(restored(item, one) for one in value)
    return value


def restored_class(kind: Any, settings: Mapping[str, Any]) -> Any:
    """Return a dataclass of its settings as plain values.

    Raises
    ------
    KeyError, TypeError
        If there is no such setting, or it is of another type.
    """
    hints = get_type_hints(kind)
    before = {f.name: f.metadata[BEFORE] for f in fields(kind) if BEFORE in f.metadata}
    whole = {**before, **settings}
    values = {name: restored(hints[name], value) for name, value in whole.items()}
    for name, value in values.items():
        if not _suits(hints[name], value):
            raise TypeError(f"{name} is {value!r}")
    return kind(**values)


def _suits(hint: Any, value: Any) -> bool:
    """Whether a value is of a type, as far as settings have types."""
    if get_origin(hint) is Annotated:
        return _suits(get_args(hint)[0], value)
    if get_origin(hint) in (Union, types.UnionType):
        return any(_suits(part, value) for part in get_args(hint))
    if get_origin(hint) is Literal:
        return any(type(value) is type(one) and value == one for one in get_args(hint))
    if get_origin(hint) is tuple:
        items, fixed = get_args(hint), Ellipsis not in get_args(hint)
        return isinstance(value, tuple) and (
            len(items) == len(value) and all(map(_suits, items, value))
            if fixed
            else all(_suits(items[0], item) for item in value)
        )
    if hint in (int, float):
        numbers = int if hint is int else (int, float)
        return isinstance(value, numbers) and not isinstance(value, bool)
    return not isinstance(hint, type) or isinstance(value, hint)


def _union(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)


def _classes(hint: Any) -> list[Any]:
    """Return the dataclasses that a setting of this type may be."""
    return [part for part in _union(hint) if is_dataclass(part)]
