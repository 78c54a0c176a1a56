"""Pages and notebooks: what they call is there, and what can run without recordings runs."""

import ast
import re
import shlex
import warnings
from functools import cache
from pathlib import Path

import pytest
from typer.main import get_command

import bayesmotion as bm
from bayesmotion import registry
from bayesmotion.cli import app

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.py"))
# Tables of equations, whose cells may hold bars.
ROW = re.compile(r"^(?:# )?\|(.*)\|$", re.MULTILINE)
# What says that a block is about files that are not here.
FILES = re.compile(r'"[^"]*\.(nc|amc|bvh|c3d|wav|mp4|csv)"')


@pytest.mark.parametrize("page", [*PAGES, *NOTEBOOKS], ids=lambda page: page.stem)
def test_links_lead_to_files_and_headings_that_are_there(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.is_file(), target
        if anchor:
            heads = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in {re.sub(r"[^\w -]", "", h).lower().replace(" ", "-") for h in heads}


def blocks(page, language):
    """Return the code blocks of a page in a language."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


def runnable():
    """Return (page, block) of all that import the package and read no files."""
    for page in PAGES:
        if page.stem == "gallery":
            continue  # one block after the other: `test_gallery`
        for number, block in enumerate(blocks(page, "python")):
            if block.startswith("import bayesmotion as bm") and not FILES.search(block):
                yield pytest.param(block, id=f"{page.stem}-{number}")


def all_code():
    for page in PAGES:
        for number, block in enumerate(blocks(page, "python")):
            yield pytest.param(block, id=f"{page.stem}-{number}")
    for notebook in NOTEBOOKS:
        yield pytest.param(notebook.read_text(encoding="utf-8"), id=notebook.stem)


@pytest.mark.parametrize("code", list(all_code()))
def test_code_needs_one_import_and_every_name_is_there(code):
    tree = ast.parse(code)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert not (node.module or "").startswith("bayesmotion"), ast.unparse(node)
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "bm":
            assert node.attr in dir(bm), f"bm.{node.attr}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_name_in_the_text_is_there(page):
    for name in re.findall(r"\bbm\.(\w+)", page.read_text(encoding="utf-8")):
        assert name in dir(bm), f"bm.{name}"


def commands():
    """Return every command, such as ``fit gait-pose``, with its options."""
    found = {}

    def walk(command, path):
        if hasattr(command, "list_commands"):
            for name in command.list_commands(None):
                walk(command.get_command(None, name), [*path, name])
        else:
            found[" ".join(path)] = {
                o for p in command.params for o in (*p.opts, *p.secondary_opts)
            }

    walk(get_command(app), [])
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_commands_on_pages_are_commands_with_these_options(page):
    known = commands()
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    for line in re.findall(r"^(?:uv run )?(bayesmotion [a-z].*)$", text, re.MULTILINE):
        words = shlex.split(line, comments=True)
        name = " ".join(words[1:3]) if words[1] == "fit" else words[1]
        assert name in known, line
        options = {word.partition("=")[0] for word in words if word.startswith("--")}
        assert options <= {*known[name], "--help"}, line


def test_the_page_of_commands_tells_of_every_command_and_option(monkeypatch):
    # Other tests register models of their own.
    monkeypatch.setattr(registry, "_REGISTERED", {})
    text = (ROOT / "docs/command-line.md").read_text(encoding="utf-8")
    # What many commands have is told once, in sections that are of no command.
    shared = re.findall(r"^## (?!`bayesmotion).*?(?=\n## |\Z)", text, re.DOTALL | re.MULTILINE)
    common = set(re.findall(r"`(--[a-z-]+)", " ".join(shared)))
    lacking = []
    for name, options in commands().items():
        if name.startswith("fit "):
            lacking += [] if f"`{name.removeprefix('fit ')}`" in text else [name]
            continue
        part = re.search(rf"## `bayesmotion {name}(?=[ `]).*?(?=\n## |\Z)", text, re.DOTALL)
        said = part[0] if part else ""
        lacking += [f"{name} {o}" for o in options
                    if o.startswith("--") and o not in said and o not in common]  # fmt: skip
    assert not lacking


@pytest.mark.slow
@pytest.mark.parametrize("code", list(runnable()))
def test_blocks_that_need_no_recordings_run(code):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bm.MotionWarning)
        exec(compile(code, "page", "exec"), {"__name__": "page"})


def shown_programs():
    """Return code that tables of equations of pages and notebooks say stands in the programs."""
    for page in [*PAGES, *NOTEBOOKS]:
        text, inside = page.read_text(encoding="utf-8"), False
        for row in ROW.findall(text):
            parts = [part.strip() for part in re.split(r"(?<!\\)\|", row)]
            head = parts[1] if len(parts) > 1 else ""
            if head.startswith("in `bayesmotion/models") or head == "program":
                inside = True
            elif parts[0] in ("model", "symbol", "setting"):
                inside = False
            elif inside and head.startswith("`"):
                yield pytest.param(head.split("`")[1], id=f"{page.stem}: {head[:40]}")


@pytest.mark.parametrize("code", list(shown_programs()))
def test_code_beside_equations_is_in_the_models(code):
    assert " ".join(code.split()) in models_code()


@cache
def models_code():
    """Return the code of all models in one line."""
    files = sorted((ROOT / "bayesmotion/models").rglob("*.py"))
    return " ".join(" ".join(file.read_text(encoding="utf-8") for file in files).split())


def test_pages_and_notebooks_have_tables_of_equations():
    """A control: the tables are found."""
    assert len(list(shown_programs())) > 30
    assert "y = numpyro.sample(nothing)" not in models_code()
