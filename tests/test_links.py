"""Links and pictures of the README and the docs lead somewhere, and every picture is shown."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
LINK = re.compile(r"\]\(([^)\s]+)\)")


def targets(page):
    """The files that a page links to, or shows."""
    # In code, brackets are not links.
    text = re.sub(r"```.*?```|`[^`\n]*`", "`", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    links = {link.split("#")[0] for link in LINK.findall(text)}
    return {page.parent / link for link in links if link and not re.match(r"[a-z]+:", link)}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    assert {path for path in targets(page) if not path.exists()} == set()


def test_every_page_and_picture_is_linked_to():
    linked = {path.resolve() for page in PAGES for path in targets(page)}
    kept = {path for path in (ROOT / "docs").rglob("*.*") if path.is_file()}
    assert kept - linked == set()
