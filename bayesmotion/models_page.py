"""The page of the models, drawn from their classes: what each is for, answers, and can be set.

``python -m bayesmotion.models_page docs/models.md docs/model.md`` writes it, and the settings
of the multifactor model into their page.
"""

import sys
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

import typer

from .catalogue import ALL, models
from .cli.settings import parameter_words, written
from .inference.methods import METHODS
from .models.multifactor import Multifactor
from .registry import model_class
from .studies.tables import write_block

INTRODUCTION = f"""
Every model answers the same verbs: {", ".join(f"`bm.{name}`" for name in ALL)}.
Tasks are those of single models; `bm.models()` gives the same table in Python, and
`bm.example(name)` a small model with recordings for it. This page is drawn from the classes by
`python -m bayesmotion.models_page docs/models.md docs/model.md`.
""".strip()
SETTINGS = """
Every setting is a keyword of the class, and an option of `bayesmotion fit MODEL`: `latent_size` is
`--latent-size`. A setting that is a small class is written there as its name in lower case, with
what differs from its defaults behind a colon: `--content gpdynamics:size=2,order=1` is
`content=bm.GPDynamics(size=2, order=1)`, and `--residual white` is `residual=bm.White()`.
""".strip()


def page() -> str:
    """Return the page: the table of models, and the settings of models and methods."""
    table = models()
    table = table[[own(model_class(str(name))) for name in table.index]]
    lines = ["# Models", "", INTRODUCTION, ""]
    lines += ["| model | paper | recordings | methods, the default first | tasks |"]
    lines += ["| --- | --- | --- | --- | --- |"]
    rows: list[dict[str, str]] = [dict(row) for row in table.reset_index().to_dict("records")]
    for row in rows:
        link = f"[`{row['model']}`](#{row['class'].lower()})"
        tasks = ", ".join(f"`bm.{task}`" for task in row["tasks"].split(", ") if task) or "-"
        lines += [f"| {link} | {row['paper']} | {row['recordings']} | {row['methods']} | {tasks} |"]
    lines += ["", "Beyond that:", ""]
    lines += [f"- `{row['model']}`: {row['further']}" for row in rows if row["further"]]
    lines += ["", SETTINGS]
    for row in rows:
        kind = model_class(row["model"])
        lines += ["", f"## {kind.__name__}", "", settings_tables(kind)]
    lines += ["", "## Methods", ""]
    lines += ['`bm.fit(model, recordings, method="nuts")`, or with settings `bm.NUTS(draws=500)`.']
    for name, kind in METHODS.items():
        lines += ["", f'`bm.{kind.__name__}`, `"{name}"`:', "", *_rows(kind)]
    return "\n".join([*lines, ""])


def own(kind: type) -> bool:
    """Whether a model is one of the collection, and not of another package."""
    return kind.__module__.startswith("bayesmotion.")


def settings_tables(kind: type) -> str:
    """Return tables of the settings of a class, and of the small classes that they can be."""
    lines = _rows(kind)
    for part in dict.fromkeys(_parts(kind)):
        if fields(part):
            lines += ["", f"`bm.{part.__name__}`:", "", *_rows(part)]
        else:
            lines += ["", f"`bm.{part.__name__}()` has no settings: {_first_line(part)}"]
    return "\n".join(lines)


def _rows(kind: Any) -> list[str]:
    words = parameter_words(kind)
    lines = ["| setting | default | meaning |", "| --- | --- | --- |"]
    for field in fields(kind):
        default = field.default
        if default is MISSING and field.default_factory is not MISSING:
            default = field.default_factory()
        usual = "" if default is MISSING else f"`{written(default)}`"
        told = words.get(field.name, "").replace("|", "\\|").replace("``", "`")
        lines.append(f"| `{field.name}` | {usual} | {told} |")
    return lines


def _parts(kind: Any) -> Iterator[Any]:
    """Return the small classes that settings can be, and those that their settings can be."""
    hints = get_type_hints(kind)
    for field in fields(kind):
        for part in _classes(hints[field.name]):
            yield part
            yield from _parts(part)


def _classes(hint: Any) -> Iterator[Any]:
    if isinstance(hint, type) and is_dataclass(hint):
        yield hint
    for inside in get_args(hint):
        yield from _classes(inside)


def _first_line(kind: type) -> str:
    first = (kind.__doc__ or "").split("\n")[0]
    return first[0].lower() + first[1:]


def main(models_page: Path, multifactor_page: Path) -> None:
    """Write the page of the models, and the multifactor model's settings into its own."""
    models_page.write_text(page(), encoding="utf-8")
    write_block(multifactor_page, "settings", settings_tables(Multifactor))


if __name__ == "__main__":
    sys.exit(typer.run(main))
