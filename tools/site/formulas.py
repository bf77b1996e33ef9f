"""Formulas as MathML, which browsers draw by themselves: a hook of mkdocs."""

import html
import re

from latex2mathml.converter import convert

FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', flags=re.DOTALL)


def on_page_content(content: str, **_: object) -> str:
    """Replaces the formulas that arithmatex has marked."""
    return FORMULA.sub(draw, content)


def draw(formula: re.Match) -> str:
    display = "block" if formula[2] == "[" else "inline"
    return convert(html.unescape(formula[3]), display=display)
