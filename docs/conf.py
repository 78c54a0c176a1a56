"""How the site is built: ``sphinx-build -W docs docs/_build/html``."""

from importlib.metadata import version as version_of

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
exclude_patterns = ["_build", "results"]
html_theme = "sphinx_book_theme"
html_title = project
html_context = {"default_mode": "auto"}
html_theme_options = {"show_toc_level": 2, "home_page_in_toc": True}
# Pages are Markdown that is read without Sphinx as well: nothing in them is run here.
nb_execution_mode = "off"
myst_enable_extensions = ["attrs_block"]
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]
autosummary_generate = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_rtype = False
default_role = "code"
