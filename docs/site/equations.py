"""Equations as pictures of curves (SVG) inside the page, made when the site is built.

A browser needs no script, no network and no mathematical font. Matplotlib, which the package has,
sets the TeX; what it does not know is a warning, which ends `make docs`.
"""

from html import escape
from typing import Any

from docutils import nodes
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser
from matplotlib.textpath import TextPath
from sphinx.util import logging

logger = logging.getLogger(__name__)
POINTS = 100.0  # of the drawing; shown in em
COMMANDS = {1: "M", 2: "L", 3: "Q", 4: "C"}  # of an SVG path, by matplotlib's code
CLOSE = 79


def setup(app: Any) -> dict[str, bool]:
    """Offer the renderer `svg`."""
    app.add_html_math_renderer("svg", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def visit_inline(translator: Any, node: nodes.Node) -> None:
    """An equation in a line of text."""
    translator.body.append(_picture(node))
    raise nodes.SkipNode


def visit_block(translator: Any, node: nodes.Node) -> None:
    """Equations on lines of their own."""
    lines = "".join(f"<div>{_picture(node, line)}</div>" for line in node.astext().split("\n\n"))
    translator.body.append(f'<div class="equation">{lines}</div>\n')
    raise nodes.SkipNode


def _picture(node: nodes.Node, text: str = "") -> str:
    try:
        return svg(text or node.astext())
    except ValueError as error:
        logger.warning("TeX that matplotlib does not set: %s", error, location=node)
        return ""


def svg(text: str) -> str:
    """The equation in the text's colour, its baseline on the line's. ValueError for unknown TeX."""
    tex = "$" + " ".join(text.split()) + "$"
    font = FontProperties(family="STIXGeneral", size=POINTS, math_fontfamily="stix")
    width, height, depth, *_ = MathTextParser("path").parse(tex, dpi=72, prop=font)
    path, drawn = TextPath((0.0, 0.0), tex, prop=font), []
    for points, code in path.iter_segments(simplify=False, curves=True):
        numbers = " ".join(
            f"{-value if index % 2 else value:.1f}" for index, value in enumerate(points)
        )
        drawn.append("Z" if code == CLOSE else COMMANDS[int(code)] + numbers)
    em = lambda length: f"{length / POINTS:.3f}em"
    box = f"0 {-(height - depth):.1f} {width:.1f} {height:.1f}"
    return (
        f'<svg class="tex" role="img" aria-label="{escape(text, quote=True)}" viewBox="{box}" '
        f'width="{em(width)}" height="{em(height)}" style="vertical-align:{em(-depth)}">'
        f'<path d="{"".join(drawn)}"/></svg>'
    )
