"""How the site is built: ``sphinx-build -W docs docs/_build/html``.

Notebooks are run for it, and kept as they are until they change (`docs/_build/.jupyter_cache`);
``-D nb_execution_mode=off`` leaves them as they are written.
"""

from importlib.metadata import version as version_of
from pathlib import Path

from sphinx.application import Sphinx

# Notebooks stand beside the pages in the repository, and below them on the site.
HERE = Path(__file__).parent
COPIES = HERE / "notebooks"
COPIES.mkdir(exist_ok=True)
for copy in COPIES.glob("*.py"):
    if not (HERE.parent / "notebooks" / copy.name).exists():
        copy.unlink()
for notebook in (HERE.parent / "notebooks").glob("*.py"):
    text = notebook.read_text(encoding="utf-8").replace("../docs/", "../")
    copy = COPIES / notebook.name
    # What has not changed is not run again.
    if not copy.exists() or copy.read_text(encoding="utf-8") != text:
        copy.write_text(text, encoding="utf-8")

project = "bayesmotion"
author = "The bayesmotion authors"
version = release = version_of("bayesmotion")
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["_build", "results", "conf.py"]
html_theme = "sphinx_book_theme"
html_title = project
html_static_path = ["_static"]
html_css_files = ["tables.css"]
html_context = {"default_mode": "auto"}
html_theme_options = {"show_toc_level": 2, "home_page_in_toc": True}
# Pages are Markdown that is read without Sphinx as well: nothing in them is run here.
nb_custom_formats = {".py": ["jupytext.reads", {"fmt": "py:percent"}]}
nb_execution_mode = "cache"
nb_execution_timeout = 1800
nb_execution_raise_on_error = True
nb_merge_streams = True
myst_enable_extensions = ["attrs_block", "dollarmath"]
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]
autosummary_generate = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_rtype = False
default_role = "code"


# Pages of other sites that turn machines away, or are not to be reached from everywhere.
linkcheck_timeout = 20
linkcheck_retries = 2
linkcheck_anchors = False
linkcheck_ignore = [r"https://doi\.org/.*", r"https?://mocap\.cs\.cmu\.edu.*"]


def _links(app: Sphinx, docname: str, source: list[str]) -> None:
    """Let links from pages to notebooks lead to where these are on the site."""
    source[0] = source[0].replace("](../notebooks/", "](notebooks/")


def setup(app: Sphinx) -> None:
    """Register what is done to the text of pages."""
    app.connect("source-read", _links)
