"""Formulas as drawings that need no script and no font in the browser: a hook of mkdocs."""

import html
import re

from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser
from matplotlib.textpath import TextPath

FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', flags=re.DOTALL)
FONT = FontProperties(size=16, math_fontfamily="stix")
EM = 16.0 * 0.92  # STIX looks smaller than the text's font


def on_page_content(content: str, **_: object) -> str:
    """Replaces the formulas that arithmatex has marked."""
    return FORMULA.sub(
        lambda found: draw(html.unescape(found[3]), is_block=found[2] == "["), content
    )


def draw(formula: str, *, is_block: bool) -> str:
    """A formula as SVG: in a line of its own, or on the text's base line."""
    text = f"${' '.join(formula.split())}$"
    width, height, depth, *_ = MathTextParser("path").parse(text, dpi=72, prop=FONT)
    path = path_data(TextPath((0, 0), text, prop=FONT))
    size = f"width:{width / EM:.3f}em;height:{height / EM:.3f}em;vertical-align:{-depth / EM:.3f}em"
    label = html.escape(text, quote=True)
    box = f"0 {depth - height:.2f} {width:.2f} {height:.2f}"
    svg = (
        f'<svg class="formula" role="img" aria-label="{label}" viewBox="{box}" style="{size}">'
        f'<path transform="scale(1 -1)" fill="currentColor" d="{path}"/></svg>'
    )
    return f'<div style="text-align:center">{svg}</div>' if is_block else svg


def path_data(outline: TextPath) -> str:
    """The outlines of all letters, as SVG writes them."""
    letters = {outline.MOVETO: "M", outline.LINETO: "L", outline.CURVE3: "Q", outline.CURVE4: "C"}
    parts = []
    for points, code in outline.iter_segments(simplify=False):
        numbers = " ".join(f"{number:.2f}" for number in points)
        parts.append("Z" if code == outline.CLOSEPOLY else f"{letters[code]}{numbers}")
    return "".join(parts)
