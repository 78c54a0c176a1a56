"""Pages and notebooks: what they call is there, and what can run without recordings runs."""

import ast
import re
import shlex
import warnings
from functools import cache
from pathlib import Path

import matplotlib
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from typer.main import get_command

import bayesmotion as bm
from bayesmotion import registry
from bayesmotion.cli import app

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.py"))
# In tests notebooks are run with few steps and draws, on recordings that are made for them.
SHORT = {
    "max_steps": 20, "initial": 1, "sweeps": 4, "em_steps": 4, "warmup": 10, "draws": 20,
    "chains": 2, "most": 40, "forecast_draws": 1, "check_draws": 4, "poses": 6, "real": False,
    "contract": False, "leave_out_people": False,
}  # fmt: skip
# Tables of equations, whose cells may hold bars.
ROW = re.compile(r"^(?:# )?\|(.*)\|$", re.MULTILINE)
# Run in a kernel as well: it is the quickest that has pictures, tables and a page.
IN_KERNEL = "voxel"
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


def test_the_page_of_commands_tells_of_every_command_and_option():
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


def cells(notebook):
    """Return (tags, code) of the cells of a notebook in percent format."""
    parts = re.split(r"^# %%(.*)\n", notebook.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return [(head, code) for head, code in zip(parts[1::2], parts[2::2], strict=True)]


def short(code):
    """Return a cell of parameters and what tests set them to."""
    names = {node.id for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Name)}
    assert names & set(SHORT)
    return "\n".join([code, *(f"{n} = {v}" for n, v in SHORT.items() if n in names)])


@pytest.mark.slow
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_a_notebook_runs_and_shows_its_pictures(notebook, monkeypatch):
    names, pictures = {"__name__": "notebook"}, 0
    monkeypatch.chdir(notebook.parent)
    monkeypatch.setattr(registry, "_REGISTERED", dict(registry._REGISTERED))
    with warnings.catch_warnings(), matplotlib.rc_context({"backend": "agg"}):
        # Few steps and draws are warned of, in many ways.
        warnings.simplefilter("ignore")
        for head, code in cells(notebook):
            if "[markdown]" in head:
                continue
            tree = ast.parse(short(code) if "parameters" in head else code)
            last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
            exec(compile(tree, notebook.name, "exec"), names)
            if last is None:
                continue
            shown = eval(compile(ast.Expression(last.value), notebook.name, "eval"), names)
            assert not isinstance(shown, Axes), ast.unparse(last)
            if isinstance(shown, Figure):
                # Without it a notebook shows the text <Figure size ...>.
                assert shown._repr_png_().startswith(b"\x89PNG"), ast.unparse(last)
                pictures += 1
            pictures += len(pyplot.get_fignums())
            pyplot.close("all")
    assert pictures


@pytest.mark.slow
def test_jupyter_shows_pictures_tables_and_pages():
    """In a kernel, as Jupyter and the site run them: pictures come as such, not as text."""
    nbclient = pytest.importorskip("nbclient", reason="the group docs: Python 3.13 and later")
    jupytext = pytest.importorskip("jupytext", reason="the group docs: Python 3.13 and later")
    notebook = jupytext.read(ROOT / "notebooks" / f"{IN_KERNEL}.py")
    for cell in notebook.cells:
        if "parameters" in cell.metadata.get("tags", ()):
            cell.source = short(cell.source)
    nbclient.NotebookClient(
        notebook, timeout=300, resources={"metadata": {"path": str(ROOT / "notebooks")}}
    ).execute()
    outputs = [out for cell in notebook.cells for out in cell.get("outputs", ())]
    shown = [out["data"] for out in outputs if "data" in out]
    assert sum("image/png" in data for data in shown) >= 3
    assert any("<table" in data.get("text/html", "") for data in shown)
    assert any("<iframe" in data.get("text/html", "") for data in shown)
    for data in shown:
        if "<Figure" in data.get("text/plain", ""):
            assert "image/png" in data
