# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Settings of Sphinx: `sphinx-build -W --keep-going docs build/site`, also for rosdoc2."""

import pathlib
import sys
from xml.etree import ElementTree

ROOT = pathlib.Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

project = 'softbody_ros'
author = copyright = 'The softbody_ros maintainers'
release = ElementTree.parse(ROOT / 'package.xml').findtext('version')

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon', 'sphinx.ext.mathjax']
html_theme = 'furo'
html_title = 'softbody_ros'
html_static_path = ['_static']
html_css_files = ['wide.css']

# as code hosts show them: anchors of headings, formulas in ```math fences
myst_heading_anchors = 3
myst_fence_as_directive = ['math']

napoleon_google_docstring = False
autodoc_member_order = 'bysource'
autodoc_typehints = 'none'  # shapes and units are in the docstrings
