"""Notebooks: each runs from its first cell to its last, and shows its pictures."""

import ast
import re
import warnings
from pathlib import Path

import matplotlib
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayesmotion import registry

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.py"))
# In tests notebooks are run with few steps and draws, on recordings that are made for them.
SHORT = {
    "max_steps": 20, "path_steps": 20, "initial": 1, "sweeps": 4, "em_steps": 4,
    "warmup": 10, "draws": 20, "chains": 2, "most": 40, "forecast_draws": 1, "check_draws": 4,
    "poses": 6, "real": False, "contract": False, "leave_out_people": False,
}  # fmt: skip
# Run in a kernel as well: it is the quickest that has pictures, tables and a page.
IN_KERNEL = "voxel"
# Run whenever tests are.
FIRST = "start_here"


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
@pytest.mark.parametrize(
    "notebook",
    [
        pytest.param(one, id=one.stem, marks=() if one.stem == FIRST else pytest.mark.thorough)
        for one in NOTEBOOKS
    ],
)
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
            if last is not None:
                shown = eval(compile(ast.Expression(last.value), notebook.name, "eval"), names)
                assert not isinstance(shown, Axes), ast.unparse(last)
                if isinstance(shown, Figure):
                    # Without it a notebook shows the text <Figure size ...>.
                    assert shown._repr_png_().startswith(b"\x89PNG"), ast.unparse(last)
                    pictures += 1
            pictures += len(pyplot.get_fignums())
            pyplot.close("all")
    assert pictures


@pytest.mark.thorough
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
