"""Sphinx's settings: the pages of this folder as a site.

``python -m sphinx -W --keep-going docs build/site`` builds it; nothing is fetched. What the pages
cite in their own form (`docs/references.md`) becomes links: `site_links.py`.
"""

import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

project = "cellctl"
author = "the maintainers of cellctl"
release = tomllib.loads((HERE.parent / "pyproject.toml").read_text())["project"]["version"]
version = release

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "site_docstrings",
    "site_links",
]
exclude_patterns = ["_build"]
nitpicky = True
# Types that the signatures name and this site does not describe: of Python, of the libraries, and
# of rooms that no script may rely on.
nitpick_ignore_regex = [
    ("py:.*", r"(?!controller\.interface\.|drivers\.kinds\.).*"),
    ("py:.*", r"drivers\.kinds\.driver\.(Device|Model|Settings|Shape)"),  # type variables
]

myst_heading_anchors = 4
myst_links_external_new_tab = False
html_theme = "furo"
html_title = f"cellctl {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_extra_path = ["control-api.json", "schemas"]
html_copy_source = False
html_show_copyright = False
# Diagrams are shown as the text that they are drawn from: no script is fetched from elsewhere.
highlight_language = "text"

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "separated"
autodoc_default_options = {"members": True, "exclude-members": "__init__, __new__"}
default_role = "code"  # single backticks of docstrings
napoleon_google_docstring = False
napoleon_use_ivar = True  # an attribute is described once: by its class
