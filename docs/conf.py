"""Settings by which Sphinx builds these pages; `make docs` runs it. Nothing is fetched from the network."""

import os
import sys
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from sinew import __version__

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_extensions"))

os.environ.setdefault("JAX_PLATFORMS", "cpu")  # or JAX tells the log that it found no other

project = "Sinew"
copyright = "the Sinew authors, Apache-2.0"  # noqa: A001  (Sphinx's name)
release = version = __version__

extensions = ["myst_parser", "mathtext_math", "sphinx_gallery.gen_gallery"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
suppress_warnings = ["myst.header"]  # a generated page may begin with its note
exclude_patterns = ["_build", "examples"]  # the gallery writes its pages from examples/ into gallery/

# Every example is run while the pages are built, in the order of their numbers; one that fails ends the build.
sphinx_gallery_conf = {
    "examples_dirs": ["examples"],
    "gallery_dirs": ["gallery"],
    "filename_pattern": r"/\d\d_",
    "ignore_pattern": r"__init__\.py",
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "remove_config_comments": True,
    "reset_modules": ("matplotlib",),
    "matplotlib_animations": False,
    "min_reported_time": 1e9,
    "show_memory": False,
    "write_computation_times": False,
    "show_signature": False,
    "plot_gallery": os.environ.get("SINEW_GALLERY", "True"),
}

html_theme = "furo"
html_title = "Sinew"
html_math_renderer = "mathtext"
html_static_path = ["_static"]
html_css_files = ["sinew.css"]
html_favicon = str(HERE.parent / "src/sinew/apps/dashboard/static/icon.svg")
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#1a5a96", "color-brand-content": "#1a5a96"},
    "dark_css_variables": {"color-brand-primary": "#7fb7ea", "color-brand-content": "#7fb7ea"},
}
html_show_sourcelink = False
html_copy_source = False


def _speak_to_screen_readers(app: Sphinx, name: str, template: str, context: dict[str, Any], tree: object) -> None:
    """Give headings of the navigation their level, and what scrolls sideways a place among the stops of the Tab key."""
    for part in ("body", "furo_navigation_tree", "toc"):
        if isinstance(context.get(part), str):
            context[part] = (
                context[part]
                .replace('role="heading">', 'role="heading" aria-level="2">')
                .replace("<pre>", '<pre tabindex="0">')
            )


def setup(app: Sphinx) -> None:
    """Connect what is done to every page, behind the theme's own (500)."""
    app.connect("html-page-context", _speak_to_screen_readers, priority=900)
