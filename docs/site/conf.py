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
myst_heading_anchors = 4
default_role = "code"
highlight_language = "text"
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autoclass_content = "class"
python_use_unqualified_type_names = True
