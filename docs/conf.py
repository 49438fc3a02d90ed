"""Settings by which Sphinx builds these pages; `make docs` runs it. Nothing is fetched from the network."""

import sys
from pathlib import Path

from sinew import __version__

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "Sinew"
copyright = "the Sinew authors, Apache-2.0"  # noqa: A001  (Sphinx's name)
release = version = __version__

extensions = ["myst_parser", "mathtext_math"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
suppress_warnings = ["myst.header"]  # a generated page may begin with its note
exclude_patterns = ["_build"]

html_theme = "alabaster"
html_math_renderer = "mathtext"
html_theme_options = {
    "description": "A resonance laboratory for tendon-driven continuum joints",
    "page_width": "1080px",
    "sidebar_width": "220px",
    "font_family": "Georgia, serif",
}
html_sidebars = {"**": ["about.html", "navigation.html", "searchbox.html"]}
html_show_sourcelink = False
