"""How `make docs` builds these pages: Sphinx, with MyST for the Markdown and furo for the looks."""

from __future__ import annotations

import sys
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "site")]

from made_pages import write  # noqa: E402

import workbench  # noqa: E402

project = "workbench"
version = release = workbench.__version__
html_title = f"workbench {version}"
html_theme = "furo"
html_static_path = ["site/site.css"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_search_summary = False  # fetched page by page, which a browser refuses for files
html_show_copyright = False
html_theme_options = {"top_of_page_buttons": []}

extensions = ["myst_parser", "sphinx.ext.autodoc", "mathml", "plain_docstrings", "offline"]
html_math_renderer = "mathml"

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4  # as far down as one page links to another
suppress_warnings = ["myst.strikethrough"]
highlight_language = "none"  # an indented block is a file, a screen or an equation; fenced ones say what they are

autodoc_default_options = {"members": True, "exclude-members": "model_config"}
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_type_aliases = {"Array": "workbench.core.run.Array"}
python_maximum_signature_line_length = 90
toc_object_entries_show_parents = "hide"

exclude_patterns = ["made"]  # what pages include, made from declarations


def setup(app: Sphinx) -> None:
    app.connect("builder-inited", lambda app: write(HERE / "made"))
