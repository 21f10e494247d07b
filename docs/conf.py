"""Sphinx configuration. Pages made from the program itself are written before the build."""

import sys
from pathlib import Path

import drcmitsuba

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
import generated  # noqa: E402
import mitsuba as mi  # noqa: E402  after drcmitsuba, which names LLVM

drcmitsuba.backend.select()
mi.set_variant("llvm_ad_rgb" if mi.variant().startswith("llvm") else "cuda_ad_rgb")
generated.write(HERE)

project = "drcmitsuba"
author = "the drcmitsuba authors"
copyright = "2026, the drcmitsuba authors"
release = drcmitsuba.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "numpydoc",
    "mathml",
]
html_math_renderer = "mathml"
exclude_patterns = ["_build"]
myst_enable_extensions = ["dollarmath", "deflist", "attrs_block"]
myst_heading_anchors = 3
suppress_warnings = ["myst.xref_missing"]  # links inside the included tables of tests/

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # NumPy-style docstrings state types, shapes and units
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

html_theme = "pydata_sphinx_theme"
html_static_path = ["_static"]
html_css_files = ["equations.css"]
html_title = "drcmitsuba"
html_theme_options = {"show_toc_level": 2, "navigation_with_keys": False}
