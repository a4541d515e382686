"""Configuration of the documentation site; it is built without a network, warnings as errors."""

from __future__ import annotations

import sys
from pathlib import Path

from foretouch import __version__

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "foretouch"
author = "the foretouch developers"
copyright = "the foretouch developers"
release = version = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "mathml", "foretouch_docs"]
exclude_patterns = ["_build", "_extensions"]
nitpicky = False
default_role = "code"  # docstrings mark code with single backticks

myst_enable_extensions = ["deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "mixed"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
python_maximum_signature_line_length = 100

html_theme = "furo"
html_title = "foretouch"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["foretouch.css"]
html_show_copyright = False
html_copy_source = False
