"""Formulas become MathML when the site is built, so that no page needs a script for them."""

import html
import re
from typing import Any

from latex2mathml.converter import convert

_FORMULA = re.compile(
    r'<(span|div) class="arithmatex">(?:\\\((?P<inline>.*?)\\\)|\\\[(?P<block>.*?)\\\])</\1>', re.DOTALL
)


def on_page_content(text: str, **_: Any) -> str:
    """mkdocs' hook: the page's HTML with every formula that arithmatex marked converted."""
    return _FORMULA.sub(_converted, text)


def _converted(found: re.Match[str]) -> str:
    block = found["block"]
    latex = html.unescape(found["inline"] if block is None else block).strip()
    if block is None:
        return convert(latex)
    return f'<div class="formula" tabindex="0">{convert(latex, display="block")}</div>'
