"""How Sphinx builds these pages: `make docs`. Nothing is fetched, neither for the build nor by a reader's browser."""

from __future__ import annotations

import sys
import tomllib
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent.parent)]

import arva_hil  # noqa: E402

project = "arva-hil"
author = "The arva-hil authors"
copyright = "The arva-hil authors"
release = version = arva_hil.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.doctest", "sphinx_pages"]
exclude_patterns = ["examples/**"]
nitpicky = True
nitpick_ignore_regex = [("py:.*", r"(?!arva_hil\.\w+$).*")]  # types of others, and what of ours is not public

myst_enable_extensions = ["alert", "dollarmath", "amsmath"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 100
autodoc_preserve_defaults = True
autodoc_inherit_docstrings = False
autodoc_type_aliases = {"ArrayLike": "ArrayLike"}
doctest_global_setup = "import math\nfrom arva_hil import *"

html_theme = "furo"
html_title = f"arva-hil {release}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_copy_source = False
html_show_sphinx = False
html_use_index = False
html_domain_indices = False
html_math_renderer = "mathml"

_settings = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8"))
_source = _settings["tool"]["hatch"]["metadata"]["hooks"]["custom"]["source"]
html_theme_options = {
    "source_view_link": f"{_source}/blob/main/docs/{{filename}}",
    "source_edit_link": f"{_source}/edit/main/docs/{{filename}}",
    "top_of_page_buttons": ["view", "edit"] if _source else [],
}
