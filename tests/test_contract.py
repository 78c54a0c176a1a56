"""The contract of all models, and of one that a user writes from the page on adding a model."""

import importlib.util
import re
from pathlib import Path

import pytest

import bayesmotion as bm

PAGE = Path(__file__).parents[1] / "docs" / "adding-a-model.md"


def blocks() -> list[str]:
    """Code blocks of the page: the model, its registration, its use, the contract."""
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)


@pytest.fixture(scope="module")
def mean_cycle(tmp_path_factory):
    """The page's model, from a file in a folder of its own."""
    path = tmp_path_factory.mktemp("package") / "mean_cycle.py"
    path.write_text(blocks()[0])
    spec = importlib.util.spec_from_file_location("mean_cycle", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return bm.register(module.MeanCycle)


def test_a_model_from_the_page_keeps_the_contract(mean_cycle):
    assert bm.check_model(mean_cycle)


def test_the_page_runs(mean_cycle):
    names = {"bm": bm, "MeanCycle": mean_cycle}
    for block in blocks()[1:]:
        exec(block, names)
    assert names["fit"].model == mean_cycle()
