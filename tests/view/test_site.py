"""The site in a browser, where it has been built: pages, tables, pictures and search."""

from pathlib import Path

import pytest

SITE = Path(__file__).parents[2] / "docs" / "_build" / "html"


@pytest.fixture
def visit(see):
    """Open a page of the site."""
    if not (SITE / "index.html").exists():
        pytest.skip("build the site first: sphinx-build -W docs docs/_build/html")
    return lambda name, **how: see(SITE / f"{name}.html", width=1100, height=800, **how)


def test_the_first_page_leads_to_all_parts(visit, shot):
    seen = visit("index")
    links = {link.get_attribute("href") for link in seen.page.locator("nav a, article a").all()}
    for page in ("which-model.html", "gallery.html", "notebooks/start_here.html", "api.html"):
        assert page in links
    shot(seen, "site")
    assert not seen.errors
    assert not seen.requests


def test_pictures_of_the_gallery_are_shown(visit):
    seen = visit("gallery")
    widths = seen.page.evaluate(
        "[...document.querySelectorAll('article img')].map(i => i.naturalWidth)"
    )
    assert len(widths) >= 9
    assert min(widths) > 100


def test_the_page_that_helps_to_choose_has_its_tables_also_in_the_dark(visit):
    seen = visit("which-model", scheme="dark")
    assert seen.page.locator("article table").count() == 2
    assert max(seen.picture("article h1")[0, 0]) < 90
