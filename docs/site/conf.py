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
html_static_path = html_css_files = ["site.css"]
html_theme_options = {"top_of_page_buttons": []}  # their words lie outside every landmark
myst_heading_anchors = 4
default_role = "code"
highlight_language = "text"
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
autoclass_content = "class"
python_use_unqualified_type_names = True


def setup(app):  # type: ignore[no-untyped-def]
    """Let a reader without a mouse or without eyes find the way: levels of captions, focus for code, names of side bars."""
    app.connect("build-finished", _named)


def _named(app, fault):  # type: ignore[no-untyped-def]
    """Write into the pages what the theme leaves out of them."""
    changes = {
        'role="heading"': 'role="heading" aria-level="2"',
        "<pre>": '<pre tabindex="0">',
        '<aside class="sidebar-drawer"': '<aside aria-label="Site" class="sidebar-drawer"',
        '<aside class="toc-drawer': '<aside aria-label="Page" class="toc-drawer',
    }
    for path in app.outdir.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        for old, new in changes.items():
            text = text.replace(old, new)
        path.write_text(text, encoding="utf-8")
