"""How Sphinx builds the documentation: `make docs`."""

from __future__ import annotations

import sys
from pathlib import Path

import condyn_pin

sys.path.insert(0, str(Path(__file__).parent))  # for the extensions beside this file

project = "condyn_pin"
author = "The condyn_pin developers"
project_copyright = author
version = release = condyn_pin.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "mathml",  # beside this file: formulas as MathML, which browsers draw by themselves
    "reference",  # beside this file: the pages of the API, from the list of public names
    "figures",  # beside this file: the figures, from the library itself
]
exclude_patterns = ["_build"]
root_doc = "index"

html_theme = "furo"
html_title = f"condyn_pin {release}"
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_math_renderer = "mathml"
html_copy_source = False

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
# Notebooks are run by every build; a cell that fails fails the build.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 600  # [s] a cell
nb_merge_streams = True
nb_execution_in_temp = True  # what a notebook writes is not left here

default_role = "py:obj"
add_module_names = False
autodoc_typehints = "none"  # docstrings say more: shapes, units, frames
autodoc_member_order = "bysource"
napoleon_google_docstring = False
# Types are words such as "(nq,) array": as text, for as references they find the wrong names.
napoleon_use_param = False
napoleon_use_rtype = False
napoleon_custom_sections = [("Attributes", "params_style")]
