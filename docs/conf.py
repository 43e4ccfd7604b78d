"""The documentation site, `make docs`: Sphinx reads docs/*.md as MyST Markdown (docs/README.md)."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / "site")]

from dronecombat_jax.machine import backend  # noqa: E402

backend.prepare("cpu")  # the reference imports JAX

project = "dronecombat-jax"
author = "the dronecombat-jax maintainers"
extensions = ["myst_parser", "sphinx.ext.autodoc", "equations", "made_pages"]
exclude_patterns = ["README.md", "site"]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3
highlight_language = "none"  # of indented blocks: shell commands and tables
default_role = "literal"  # `name` in a docstring
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
html_theme = "furo"
html_title = project
html_math_renderer = "svg"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_show_copyright = False
html_copy_source = False
