"""Pages of the site that are no files in docs: a hook of mkdocs.

The notebooks become the tutorial, the stubs' public names the reference, a page for each sub-room.
Where a page links to a file outside docs, that file becomes a page, too: it is shown as it is.
"""

import ast
import posixpath
import re
import sys
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import CombinedEvent, event_priority
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))
from public_names import ROOT, by_room  # noqa: E402

PAGES = {"CHANGELOG.md": "changelog.md", "CONTRIBUTING.md": "contributing.md"}
LINK = re.compile(r"(?<=\]\()([^)\s#]+)(?=[)#])")
CODE = re.compile(r"(^```.*?^```)", flags=re.DOTALL | re.MULTILINE)
LANGUAGES = {".py": "python", ".yaml": "yaml", ".csv": "text", ".toml": "toml"}
HIDDEN = "---\nsearch: {exclude: true}\n---\n\n"


def on_config(config: MkDocsConfig) -> None:
    """Fills in what the tabs Tutorial and Reference show."""
    assert config.nav is not None
    tabs = {name: pages for entry in config.nav for name, pages in entry.items()}
    tabs["Tutorial"] += [f"notebooks/{path.name}" for path in notebooks()]
    if (ROOT / "docs" / "howto" / "ros.md").exists():
        tabs["How-to"].append({"Recordings and robots of ROS": "howto/ros.md"})
    folders: dict[str, list] = {}
    for room in by_room():
        folders.setdefault(room.split("/")[0], []).append({title_of(room): f"reference/{room}.md"})
    tabs["Reference"] += [{room: pages} for room, pages in folders.items()]


@event_priority(100)  # before mkdocs-jupyter looks for notebooks
def add_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages."""
    for path in notebooks():
        name, urls = f"notebooks/{path.name}", config.use_directory_urls
        files.append(File(name, str(ROOT), config.site_dir, urls))
    files.append(File("site.css", str(HERE), config.site_dir, config.use_directory_urls))
    for source, name in PAGES.items():
        files.append(File.generated(config, name, content=(ROOT / source).read_text("utf-8")))
    for room, names in by_room().items():
        name = f"reference/{room}.md"
        files.append(File.generated(config, name, content=reference_page(room, names)))
    pages = {f.src_uri: f.content_string for f in files if f.src_uri.endswith(".md")}
    for outside in sorted({path for page in pages.items() for path in outside_links(*page)}):
        name = source_page(outside)
        if files.get_file_from_path(name) is None:
            files.append(File.generated(config, name, content=show_source(outside)))
    return files


@event_priority(-100)  # after it
def name_notebooks(files: Files, config: MkDocsConfig) -> Files:
    """Gives notebooks a browser's ending, which mkdocs-jupyter forgets for pages on the disk."""
    for file in files:
        if file.src_uri.endswith(".ipynb"):
            file.dest_uri = file.url = file.src_uri.replace(".ipynb", ".html")
            file.abs_dest_path = str(Path(config.site_dir) / file.dest_uri)
    return files


on_files = CombinedEvent(add_files, name_notebooks)


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Leads links to files outside docs to their pages; indents inner lists as mkdocs wants it."""
    folder = posixpath.dirname(page.file.src_uri)

    def lead(match: re.Match) -> str:
        outside = outside_path(match[1], page.file.src_uri)
        return posixpath.relpath(source_page(outside), folder or ".") if outside else match[1]

    if page.file.src_uri.startswith("source/"):
        return markdown
    parts = CODE.split(LINK.sub(lead, markdown))  # texts at even places, code at odd ones
    parts[::2] = [re.sub(r"^  (?=- )", "    ", text, flags=re.MULTILINE) for text in parts[::2]]
    return "".join(parts)


def notebooks() -> list[Path]:
    return sorted((ROOT / "notebooks").glob("*.ipynb"))


def title_of(room: str) -> str:
    return room.split("/")[1].removesuffix(".py").replace("_", " ")


def reference_page(room: str, names: list[str]) -> str:
    """A sub-room's page: the question it answers, and its public names."""
    package = ROOT / "mffdrake" / room
    source = package / "__init__.py" if package.is_dir() else package.with_suffix(".py")
    doc = ast.get_docstring(ast.parse(source.read_text(encoding="utf-8"))) or ""
    blocks = [f"# {title_of(room).capitalize()}", doc, *(f"::: {name}" for name in names)]
    return "\n\n".join(blocks) + "\n"


def outside_path(link: str, page: str) -> str | None:
    """The path in the checkout of what a page links to, where that is outside docs."""
    if re.match(r"[a-z]+:", link):
        return None
    base = "" if page in PAGES.values() else "docs"
    path = posixpath.normpath(posixpath.join(base, posixpath.dirname(page), link))
    is_outside = not path.startswith("docs/") or base == ""
    return path if is_outside and (ROOT / path).exists() else None


def outside_links(page: str, text: str) -> set[str]:
    return {path for link in LINK.findall(text) if (path := outside_path(link, page))}


def source_page(path: str) -> str:
    """The page that shows a file of the checkout."""
    if path in PAGES:
        return PAGES[path]
    if path.startswith("docs/"):
        return path.removeprefix("docs/")
    if path.endswith(".ipynb"):
        return path
    return f"source/{path}.md"


def show_source(path: str) -> str:
    """A file's text as a page; a folder's names."""
    place = ROOT / path
    if place.is_dir():
        names = sorted(
            f"- `{inner.name}`" for inner in place.iterdir() if inner.name[0] not in "._"
        )
        return "\n".join([f"{HIDDEN}# {path}\n", *names, ""])
    language = LANGUAGES.get(place.suffix, "text")
    return f"{HIDDEN}# {path}\n\n~~~~~~{language}\n{place.read_text(encoding='utf-8')}\n~~~~~~\n"
