"""Equations as pictures inside the page, by matplotlib's mathtext.

Sphinx's own renderers need LaTeX or a script from the network; the pages shall open on a machine that has neither.
"""

import base64
import io
from typing import Any

from docutils import nodes
from matplotlib import mathtext, rc_context
from matplotlib.font_manager import FontProperties
from sphinx.application import Sphinx

_POINTS = 11.5


def _picture(equation: str) -> tuple[str, float]:
    """Return (SVG as a data address, depth below the baseline in points) of one line of mathematics."""
    font = FontProperties(size=_POINTS, math_fontfamily="stix")
    file = io.BytesIO()
    with rc_context({"savefig.transparent": True}):  # a dark page turns the strokes white
        depth = mathtext.math_to_image(f"${equation}$", file, prop=font, dpi=72, format="svg")
    return "data:image/svg+xml;base64," + base64.b64encode(file.getvalue()).decode(), float(depth)


def _image(translator: Any, equation: str) -> str:
    address, depth = _picture(equation)
    style = f"vertical-align: -{depth:.1f}pt"
    return f'<img class="math" src="{address}" alt="{translator.encode(equation).strip()}" style="{style}">'


def _inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(_image(translator, " ".join(node.astext().split())))
    raise nodes.SkipNode


def _block(translator: Any, node: nodes.math_block) -> None:
    # An empty line in the source begins the next equation.
    for equation in node.astext().split("\n\n"):
        line = _image(translator, " ".join(equation.split()))
        translator.body.append(f'<p style="text-align: center">{line}</p>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer under the name `mathtext`."""
    app.add_html_math_renderer("mathtext", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
