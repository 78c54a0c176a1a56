"""The public face: one import, one table, pages that show what the code gives."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import bayesmotion as bm
from bayesmotion import models_page, registry
from bayesmotion.catalogue import TASKS
from bayesmotion.models.multifactor import Multifactor
from bayesmotion.registry import model_class, model_names

ROOT = Path(__file__).parent.parent


def imported_for_type_checkers():
    """Return {module: names} of the imports that only type checkers see."""
    tree = ast.parse(Path(bm.__file__).read_text(encoding="utf-8"))
    (block,) = [n for n in tree.body if isinstance(n, ast.If) and "TYPE_CHECKING" in ast.dump(n)]
    found = {}
    for node in block.body:
        assert isinstance(node, ast.ImportFrom)
        found[node.module] = {alias.name for alias in node.names}
    return found


def test_the_table_and_the_imports_for_type_checkers_are_the_same():
    found = imported_for_type_checkers()
    assert found.pop(None) == set(bm._MODULES)
    assert found == {module: set(names) for module, names in bm._PUBLIC.items()}


def test_every_public_name_is_there_once_and_is_what_its_module_has():
    names = [name for names in bm._PUBLIC.values() for name in names]
    assert len(set(names)) == len(names)
    assert set(dir(bm)) == {*names, *bm._MODULES}
    for name in dir(bm):
        assert getattr(bm, name) is not None
    with pytest.raises(AttributeError):
        bm.no_such_name  # noqa: B018


def test_every_model_is_public_with_the_classes_that_its_settings_can_be():
    for name in model_names():
        kind = model_class(name)
        if not models_page.own(kind):
            continue  # registered by another test
        assert getattr(bm, kind.__name__) is kind
        for part in models_page._parts(kind):
            assert getattr(bm, part.__name__) is part, f"{name}: {part}"


def test_every_task_of_the_table_is_public():
    assert set(TASKS) <= set(dir(bm))


def test_importing_the_package_is_light():
    program = "import sys, bayesmotion; print('numpyro' in sys.modules, 'arviz' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stdout.split() == ["False", "False"], run.stderr


def test_the_page_of_models_is_what_the_code_gives(monkeypatch):
    # Other tests register models of their own.
    monkeypatch.setattr(registry, "_REGISTERED", {})
    assert models_page.page() == (ROOT / "docs/models.md").read_text(encoding="utf-8")


def test_the_page_of_the_multifactor_model_has_its_settings():
    shown = models_page.settings_tables(Multifactor)
    assert shown in (ROOT / "docs/model.md").read_text(encoding="utf-8")


def test_the_index_links_every_page():
    index = (ROOT / "docs/index.md").read_text(encoding="utf-8")
    for page in [*(ROOT / "docs").glob("*.md"), *(ROOT / "notebooks").glob("*.py")]:
        assert page.name == "index.md" or page.name in index, page.name


def test_the_reference_lists_every_public_name_once():
    listed = re.findall(r"^   (\w+)$", (ROOT / "docs/api.md").read_text(encoding="utf-8"), re.M)
    assert sorted(listed) == sorted(set(dir(bm)) - set(bm._MODULES))


def test_the_site_has_every_page_and_notebook_once():
    index = (ROOT / "docs/index.md").read_text(encoding="utf-8")
    trees = re.findall(r"```{toctree}\n:hidden:\n:caption: [^\n]*\n\n(.*?)```", index, re.DOTALL)
    pages = {page.stem for page in (ROOT / "docs").glob("*.md")} - {"index"}
    pages |= {f"notebooks/{page.stem}" for page in (ROOT / "notebooks").glob("*.py")}
    assert sorted(" ".join(trees).split()) == sorted(pages)
