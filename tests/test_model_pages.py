"""What pages of models say of priors and costs is what the programs and results say."""

import re
from pathlib import Path

import pytest

import bayesmotion as bm
from bayesmotion import model_pages, registry
from bayesmotion.registry import model_class, model_names

DOCS = Path(__file__).parent.parent / "docs"
TEXTS = {page.stem: page.read_text(encoding="utf-8") for page in DOCS.glob("*.md")}
OWN = [name for name in model_names() if model_pages.own(model_class(name))]


def block(name):
    """Return the block of a name, and the page that has it."""
    found = [
        (page, text)
        for page, whole in TEXTS.items()
        for text in re.findall(rf"<!-- results:{name} -->\n(.*?)<!-- /results -->", whole, re.S)
    ]
    assert len(found) == 1, name
    return found[0]


@pytest.mark.parametrize("name", OWN)
def test_every_model_has_a_page_with_its_priors_and_a_picture(name):
    _, text = block(f"priors-{name}")
    sites = model_pages.programs_sites(name)
    rows = {row[0]: row for row in re.findall(r"^\| `(\w+)` \| [^|]* \| ([^|]*) \|", text, re.M)}
    assert list(rows) == list(sites)
    for site, prior in sites.items():
        assert rows[site][1] == model_pages.family(prior), site
    picture = DOCS / "images" / f"prior-{name}.svg"
    assert f"images/{picture.name}" in text
    assert 2e3 < picture.stat().st_size < 4e5


@pytest.mark.parametrize("name", OWN)
def test_the_page_of_notation_names_every_site_with_its_unit(name):
    units = model_pages.units_of(TEXTS["notation"])[name]
    model, _ = bm.example(name)
    assert set(model_pages.programs_sites(name)) <= set(units)
    assert all(units[site] for site in model_pages.programs_sites(name))
    # What it names is there: in the program, or among what the model names.
    outputs = set(units) - set(model_pages.programs_sites(name))
    assert outputs <= {*model.dims(), "alpha_part"}


def test_the_page_that_helps_to_choose_has_the_table(monkeypatch):
    monkeypatch.setattr(registry, "_REGISTERED", {})
    _, text = block("which-model")
    assert text.strip() == model_pages.choice(DOCS / "results")
    assert re.search(r": \d+ s \|", text)
