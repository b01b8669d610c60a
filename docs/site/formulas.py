"""Formulas become drawings when the site is built: no page needs a script, or a special font, for them."""

import html
import re
from typing import Any

from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser
from matplotlib.path import Path
from matplotlib.textpath import TextPath

_FORMULA = re.compile(
    r'<(span|div) class="arithmatex">(?:\\\((?P<inline>.*?)\\\)|\\\[(?P<block>.*?)\\\])</\1>', re.DOTALL
)
_SIZE = 100.0  # units an em; the drawing is scaled to the text's
_FONT = FontProperties(size=_SIZE, math_fontfamily="stix")
_LETTERS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C"}


def on_page_content(text: str, **_: Any) -> str:
    """mkdocs' hook: the page's HTML with every formula that arithmatex marked drawn."""
    return _FORMULA.sub(_drawn, text)


def _drawn(found: re.Match[str]) -> str:
    inline = found["block"] is None
    latex = html.unescape(found["inline"] if inline else found["block"]).strip().replace("\n", " ")
    # numerators and sums of a formula in a line of its own are not made small
    formula = f"${latex if inline else latex.replace(chr(92) + 'frac', chr(92) + 'dfrac')}$"
    width, _, depth, *_ = MathTextParser("path").parse(formula, 72, _FONT)
    path = TextPath((0.0, 0.0), formula, size=_SIZE, prop=_FONT)
    box = path.get_extents()
    below, above = max(depth, -box.y0) + 2.0, box.y1 + 2.0
    data = " ".join(_commands(path))
    width, height = width + 4.0, above + below
    drawing = (
        f'<svg class="formula" role="img" aria-label="{html.escape(latex)}" '
        f'viewBox="0 {-above:.0f} {width:.0f} {height:.0f}" style="width:{width / _SIZE:.2f}em;'
        f'height:{height / _SIZE:.2f}em;vertical-align:{-below / _SIZE:.2f}em">'
        f'<path d="{data}" fill="currentColor"/></svg>'
    )
    return drawing if inline else f'<div class="formula" tabindex="0">{drawing}</div>'


def _commands(path: Path) -> list[str]:
    parts = []
    for points, code in path.iter_segments(curves=True, simplify=False):
        if code == Path.CLOSEPOLY:
            parts.append("Z")
        else:
            numbers = (f"{-value:.1f}" if at % 2 else f"{value:.1f}" for at, value in enumerate(points))
            parts.append(_LETTERS[code] + " ".join(numbers))
    return parts
