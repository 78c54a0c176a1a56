"""Options of commands made from the types of settings, so that there is one list of both.

A setting becomes the option of its name, a flag where it is true or false, its help the
words of the class's docstring. Settings that are small dataclasses themselves are written as
their name in lower case, with what differs from the defaults behind a colon:

    --content gpdynamics:size=2,order=1     content=GPDynamics(size=2, order=1)
    --factors subject:novel_dims=1;gait     factors=(Factor("subject", novel_dims=1), ...)
"""

import inspect
import re
import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import typer

from ..errors import InputError


def options_of(kind: type) -> list[inspect.Parameter]:
    """Return an option for every setting of a dataclass; None where it was not given."""
    hints, words = get_type_hints(kind), parameter_words(kind)
    out = []
    for field in fields(kind):
        default = field.default
        if default is MISSING and field.default_factory is not MISSING:
            default = field.default_factory()
        out.append(option(field.name, hints[field.name], default, words.get(field.name, "")))
    return out


def option(name: str, hint: Any, default: Any, words: str) -> inspect.Parameter:
    """Return the option of one setting, whose own default is None: not given."""
    told = " ".join(part for part in (words, _choices(hint), _default(default)) if part)
    flag = f"--{name.replace('_', '-')}"
    if _plain(hint) is bool:
        how = typer.Option(f"{flag}/--no-{name.replace('_', '-')}", help=told)
        annotation: Any = Annotated[bool | None, how]
    elif _plain(hint) in (int, float, Path):
        annotation = Annotated[_plain(hint) | None, typer.Option(flag, help=told)]
    else:
        annotation = Annotated[str | None, typer.Option(flag, help=told)]
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation
    )


def with_options(
    function: Callable[..., None], parameters: list[inspect.Parameter]
) -> Callable[..., None]:
    """Return the function with these parameters as its signature, for Typer to read."""

    def command(**values: Any) -> None:
        function(**values)

    command.__doc__ = function.__doc__
    command.__name__ = function.__name__
    command.__signature__ = inspect.Signature(parameters)  # pyright: ignore[reportFunctionMemberAccess]
    command.__annotations__ = {p.name: p.annotation for p in parameters}
    return command


def settings_from(kind: type, given: Mapping[str, Any], where: str = "--") -> dict[str, Any]:
    """Return the settings of a dataclass that were given, each of its type.

    Raises
    ------
    InputError
        If a text is not what the setting can be.
    """
    hints = get_type_hints(kind)
    return {
        name: parsed(hints[name], value, f"{where}{name.replace('_', '-')} {value}")
        for name, value in given.items()
        if value is not None
    }


def parsed(hint: Any, value: Any, where: str) -> Any:
    """Return a value of a type from a text (or a number or flag that it is already).

    Raises
    ------
    InputError
        If the text is none of the type's.
    """
    if not isinstance(value, str):
        return value
    options = [part for part in _union(hint) if part is not types.NoneType]
    if value == "none" and types.NoneType in _union(hint):
        return None
    classes: list[Any] = [part for part in options if is_dataclass(part)]
    if classes:
        return _parsed_class(classes, value, where)
    (one, *_) = options
    if get_origin(one) is Literal:
        known = get_args(one)
        found = {str(item): item for item in known}
        if value not in found:
            raise InputError(where, "there is no such", f"Use {', '.join(found)}")
        return found[value]
    if get_origin(one) is tuple:
        item = get_args(one)[0]
        separator = ";" if any(is_dataclass(part) for part in _union(item)) else ","
        if separator == ";" and ";" not in value and ":" not in value:
            separator = ","
        parts = [part.strip() for part in value.split(separator) if part.strip()]
        return () if value == "none" else tuple(parsed(item, part, where) for part in parts)
    if one is bool:
        if value.lower() not in ("true", "false"):
            raise InputError(where, "it is neither true nor false", "Write true or false")
        return value.lower() == "true"
    try:
        return one(value)
    except (TypeError, ValueError) as error:
        raise InputError(where, f"it is no {one.__name__}", "Give a number") from error


def _parsed_class(classes: list[Any], text: str, where: str) -> Any:
    """Return a small dataclass from ``name:setting=value,...``; a name alone of the only one.

    Of a class that has a name of its own as first setting (a factor), the text before the
    colon is that name.
    """
    head, _, rest = text.partition(":")
    by_name = {kind.__name__.lower(): kind for kind in classes}
    first: dict[str, Any] = {}
    if head.lower() in by_name:
        kind = by_name[head.lower()]
    elif len(classes) == 1 and fields(classes[0])[0].name == "name":
        kind, first = classes[0], {"name": head}
    else:
        raise InputError(where, f"{head!r} is none", f"Use {', '.join(by_name)}")
    given = dict(first)
    names = [field.name for field in fields(kind)]
    for part in filter(None, rest.split(",")):
        name, sign, value = part.partition("=")
        if not sign or name not in names:
            raise InputError(where, f"{part!r} is no setting of {head}",
                             f"Write name=value; it has {', '.join(names)}")  # fmt: skip
        given[name] = value
    return kind(**settings_from(kind, given, f"{where}: "))


def parameter_words(kind: Any) -> dict[str, str]:
    """Return what a docstring says of every parameter, in one line each.

    Of a class those of its bases count too.
    """
    if isinstance(kind, type):
        texts = [inspect.cleandoc(one.__doc__ or "") for one in reversed(kind.__mro__[:-1])]
    else:
        texts = [inspect.getdoc(kind) or ""]
    return {name: words for text in texts for name, words in _words(text).items()}


def _words(text: str) -> dict[str, str]:
    found = re.search(r"Parameters\n-+\n(.*?)(?:\n[A-Z]\w+\n-+\n|\Z)", text, re.DOTALL)
    body = found[1] if found else text
    out: dict[str, str] = {}
    for block in re.finditer(r"^(\w[\w, ]*)\n((?:[ ]{4}.*\n?|\n)+)", body, re.MULTILINE):
        words = " ".join(block[2].split())
        for name in block[1].split(","):
            out[name.strip()] = words
    return out


def _union(hint: Any) -> tuple[Any, ...]:
    return get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)


def _plain(hint: Any) -> Any:
    """Return the one type of a hint that may be None."""
    parts = [part for part in _union(hint) if part is not types.NoneType]
    return parts[0] if len(parts) == 1 else None


def _choices(hint: Any) -> str:
    """Name what a setting can be, where that is not told by its type."""
    parts = [part for part in _union(hint) if part is not types.NoneType]
    if get_origin(parts[0]) is tuple:
        parts = list(_union(get_args(parts[0])[0]))
    if get_origin(parts[0]) is Literal:
        return f"One of {', '.join(map(str, get_args(parts[0])))}."
    if len(parts) > 1 and all(is_dataclass(part) for part in parts):
        return f"One of {', '.join(map(_class_words, parts))}."
    return ""


def _class_words(kind: Any) -> str:
    names = ",".join(f"{field.name}=" for field in fields(kind))
    return kind.__name__.lower() + (f"[:{names}]" if names else "")


def _default(default: Any) -> str:
    if default is MISSING or default is None:
        return ""
    return f"By default {written(default)}."


def written(value: Any) -> str:
    """Return a setting as it is written on the command line."""
    if is_dataclass(value) and not isinstance(value, type):
        parts = {field.name: getattr(value, field.name) for field in fields(value)}
        usual = {field.name: field.default for field in fields(value)}
        head = str(parts.pop("name")) if "name" in parts else type(value).__name__.lower()
        rest = ",".join(f"{n}={written(v)}" for n, v in parts.items() if v != usual[n])
        return f"{head}:{rest}" if rest else head
    if isinstance(value, tuple):
        deep = any(is_dataclass(item) for item in value)
        return (";" if deep else ",").join(map(written, value)) or "none"
    if isinstance(value, bool):
        return str(value).lower()
    return "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
