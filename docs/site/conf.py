"""Sphinx's settings for the documentation site; make_site.py calls Sphinx with them."""

from importlib.metadata import version as version_of

project = "Antinode"
author = "The Antinode authors"
copyright = author
version = release = version_of("antinode")

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
root_doc = "index"
exclude_patterns = ["site"]
suppress_warnings = ["myst.header"]  # decisions start below a title of their own

html_theme = "furo"
html_title = f"Antinode {version}"
html_show_sphinx = False
html_theme_options = {"top_of_page_buttons": []}  # their words lie outside every landmark
myst_heading_anchors = 4
default_role = "code"
highlight_language = "text"
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autoclass_content = "class"
python_use_unqualified_type_names = True


def setup(app):  # type: ignore[no-untyped-def]
    """Give the captions of the theme's navigation the level that a heading needs."""
    app.connect("html-page-context", _levels, priority=900)


def _levels(app, page, template, context, doctree):  # type: ignore[no-untyped-def]
    tree = "furo_navigation_tree"
    context[tree] = context.get(tree, "").replace('role="heading"', 'role="heading" aria-level="2"')
