"""Port diagrams in the reference: an extension of griffe, which reads the docstrings.

Drake's documentation draws the block that follows ``.. pydrake_system::`` as a box with the input
ports to the left and the output ports to the right; so does this. The section ``Ports:`` becomes a
list, and public names in backticks become links.
"""

import ast
import html
import re
import sys
import textwrap
from itertools import pairwise
from pathlib import Path
from typing import Any

import griffe
import yaml

sys.path.insert(0, str(Path(__file__).parent))
from public_names import public_names

BLOCK = re.compile(r"^\.\. pydrake_system::\n((?:[ ]+.*\n|\n)+)", flags=re.MULTILINE)
PORTS = re.compile(r"^Ports:\n((?:[ ]+.*(?:\n|\Z)|\n)+)", flags=re.MULTILINE)
NAMES = public_names()


class PortDiagrams(griffe.Extension):
    """Rewrites each docstring once it is read, and finds names that are assigned together."""

    def on_module_members(self, *, node: ast.AST, mod: griffe.Module, **_: Any) -> None:
        # griffe itself passes over `RED, GREEN, BLUE = ...`.
        for assigned, below in pairwise(getattr(node, "body", [])):
            if not isinstance(assigned, ast.Assign) or not isinstance(below, ast.Expr):
                continue
            for target in assigned.targets:
                for name in target.elts if isinstance(target, ast.Tuple) else ():
                    doc = griffe.Docstring(ast.literal_eval(below.value), parent=mod)
                    mod.set_member(name.id, griffe.Attribute(name.id, docstring=doc))

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring is not None and not obj.is_alias:
            obj.docstring.value = rewritten(obj.docstring.value)


def rewritten(text: str) -> str:
    """A docstring with its diagram, its ports and its links."""
    text = BLOCK.sub(lambda found: diagram(yaml.safe_load(textwrap.dedent(found[1]))), text)
    text = re.sub(r"^Example:$", "Examples:", text, flags=re.MULTILINE)  # griffe's word
    text = PORTS.sub(lambda found: port_list(textwrap.dedent(found[1])), text)
    return re.sub(r"(?<![`\w\[.])`(\w+)`(?![`\w\]])", link, text)


def link(name: re.Match) -> str:
    """A public name, linked to where it is documented."""
    return f"[`{name[1]}`][{NAMES[name[1]]}]" if name[1] in NAMES else f"`{name[1]}`"


def diagram(block: dict[str, Any]) -> str:
    """The box of a system."""
    sides = []
    for side, arrow in (("input_ports", "{} &rarr;"), ("output_ports", "&rarr; {}")):
        ports = [html.escape(str(port)) for port in block.get(side, [])]
        ports = [port.replace(" (optional)", " <i>(optional)</i>") for port in ports]
        sides.append("<br>".join(arrow.format(port) for port in ports))
    cells = f'<td class="in">{sides[0]}</td><th>{block["name"]}</th><td class="out">{sides[1]}</td>'
    return f'<table class="ports"><tr>{cells}</tr></table>\n\n'


def port_list(section: str) -> str:
    """What each port carries."""
    ports = re.findall(r"^(\w[^:\n]*): (.*(?:\n(?:[ ]+.*|$))*)", section, flags=re.MULTILINE)
    items = [f"- `{name}`: {' '.join(text.split())}" for name, text in ports]
    return "\n".join(["**Ports:**\n", *items, "", ""])
