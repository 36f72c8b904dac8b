"""The manual: `make docs` builds it from these pages, the docstrings, the keys of a scene and the examples."""

import logging
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))

import pmr  # noqa: E402

logging.getLogger("fontTools").setLevel(logging.WARNING)  # what a report says of its fonts

project = "pmr"
release = version = pmr.__version__
project_copyright = "pmr developers"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx-mathjax-offline",  # formulas without a network
    "sphinx_gallery.gen_gallery",
    "keys",
    "commands",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "_ext", "examples", "sg_execution_times.rst"]
suppress_warnings = ["config.cache"]
nitpicky = False

myst_enable_extensions = ["dollarmath", "amsmath", "deflist", "colon_fence", "fieldlist"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 3

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": "/",  # all of them are executed
    "within_subsection_order": "gallery.in_order",
    "image_scrapers": ("matplotlib", "gallery"),
    "reset_modules": ("matplotlib", "gallery.unprinted"),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "min_reported_time": 3600,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "backreferences_dir": None,
}

autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"pmr {release}"
html_logo = "_static/logo.svg"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_copy_source = False
html_show_sphinx = False
