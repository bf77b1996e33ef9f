"""docs/equations.md: every equation of the paper, and whether what the page names is there."""

import ast
import importlib
import io
import re
import tokenize
from functools import cache
from pathlib import Path

import pytest
from matplotlib.mathtext import MathTextParser

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "equations.md"
TEXT = PAGE.read_text(encoding="utf-8")
ENTRIES = re.findall(r"^### \(([\d.A]+)\) .+?\n(.*?)(?=^##|\Z)", TEXT, flags=re.M | re.S)
LINKS = re.findall(r"\[([^]]*)\]\(([^)]*)\)", TEXT)
NUMBER = r"\((?:A\.)?\d+\)"
CITATION = re.compile(rf"(?:Eqs?\.|[Ee]quations?) ({NUMBER}(?:(?:, and |, | and |-){NUMBER})*)")

every_entry = pytest.mark.parametrize(("number", "body"), ENTRIES, ids=[n for n, _ in ENTRIES])


def named_code(body):
    """Dotted names and the files they link to."""
    return re.findall(r"\[`([\w.]+)`\]\(\.\./(mffdrake/[\w/]+\.py)\)", body)


def named_tests(body):
    """Files, test names, and the files they link to."""
    return re.findall(r"\[`([\w/]+\.py)::(\w+)`\]\(\.\./tests/([\w/]+\.py)\)", body)


@cache
def definitions(path):
    """Dotted name -> whole lines of source, of all functions and classes of a file."""
    source = path.read_text(encoding="utf-8")
    lines = source.splitlines(keepends=True)
    found = {}

    def collect(node, prefix):
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.ClassDef):
                found[prefix + child.name] = "".join(lines[child.lineno - 1 : child.end_lineno])
                collect(child, f"{prefix}{child.name}.")

    collect(ast.parse(source), "")
    return found


def cited(source):
    """Numbers of the equations that comments and docstrings cite; ranges count in full."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    words = [t.string for t in tokens if t.type in (tokenize.COMMENT, tokenize.STRING)]
    numbers = set()
    for chain in CITATION.findall("\n".join(words)):
        numbers |= set(re.findall(r"[\dA.]+", chain))
        for first, last in re.findall(r"\((\d+)\)-\((\d+)\)", chain):
            numbers |= {str(n) for n in range(int(first), int(last) + 1)}
    return numbers


def anchors(path):
    """GitHub's anchors of a page's headings."""
    headings = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), flags=re.M)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_citations_are_found():
    """What the checks below rest on."""
    source = '"""As Eqs. (3), (5)-(7) and (A.8), not (9)."""\nx = f(2)  # Eq. (4)\n'
    assert cited(source) == {"3", "4", "5", "6", "7", "A.8"}


def test_every_equation_has_one_entry_in_the_paper_s_order():
    numbers = [str(n) for n in range(1, 32)]
    numbers.insert(numbers.index("7"), "A.8")
    assert [number for number, _ in ENTRIES] == numbers


@every_entry
def test_an_entry_has_a_formula_code_and_a_test(number, body):
    formula = body.strip().split("\n\n")[0]
    assert re.search(r"\$[^$]+\$", formula)
    assert named_code(body)
    assert named_tests(body)


@every_entry
def test_named_code_can_be_imported_from_the_linked_file_and_cites_the_equation(number, body):
    for name, file in named_code(body):
        module = ".".join(Path(file).with_suffix("").parts)
        assert f"mffdrake.{name}".startswith(f"{module}."), name
        qualified = f"mffdrake.{name}".removeprefix(f"{module}.")
        value = importlib.import_module(module)
        for part in qualified.split("."):
            value = getattr(value, part)
        source = definitions(ROOT / file)[qualified]
        if Path(file).parts[1] in ("recognition", "systems"):
            assert number in cited(source), f"({number}) is not mentioned in {name}"


@every_entry
def test_named_tests_exist(number, body):
    for file, name, linked in named_tests(body):
        assert file == linked
        assert name.startswith("test_")
        assert name in definitions(ROOT / "tests" / file), f"{file}::{name}"


def test_every_link_leads_somewhere():
    assert len(LINKS) > 31
    for _, link in LINKS:
        path, _, anchor = link.partition("#")
        target = (PAGE.parent / path).resolve()
        assert target.is_relative_to(ROOT) and target.is_file(), link
        assert not anchor or anchor in anchors(target), link


def test_every_link_to_code_and_tests_is_one_of_those_checked_above():
    checked = sum(len(named_code(body)) + len(named_tests(body)) for _, body in ENTRIES)
    assert checked == sum(".py" in link for _, link in LINKS)


def test_the_summary_lists_what_the_entries_correct_and_settle():
    introduction = TEXT.split("\n## ")[0]
    for label in ("Corrected", "Open"):
        [line] = re.findall(rf"^- \*\*{label}\*\* ?.*?: (.*)\.$", introduction, flags=re.M)
        numbers = [number for number, body in ENTRIES if f"**{label}:**" in body]
        assert re.findall(r"\(([\dA.]+)\)", line) == numbers


def test_formulas_are_well_formed_and_survive_markdown():
    """GitHub reads Markdown first: it eats backslashes before punctuation and may see emphasis."""
    formulas = re.findall(r"\$([^$]+)\$", TEXT)
    assert len(formulas) > 31 and TEXT.count("$") == 2 * len(formulas)
    parser = MathTextParser("path")
    for formula in formulas:
        assert not re.search(r"\\[^a-zA-Z]|[*]|[<>](?! )|[^a-zA-Z0-9]_", formula), formula
        parser.parse(f"${formula}$")
