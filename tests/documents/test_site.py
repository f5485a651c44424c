"""The documents become a site: no link is broken, nothing comes from elsewhere, and the lines of the code are where it says."""

from __future__ import annotations

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import pytest
from tests.support.documents import DOCUMENTS
from tests.support.places import DOCS, ROOT
from tests.support.waiting import PATIENCE

from echogrid import client

TAKEN = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}  # what a browser fetches by itself


def build(source: Path, out: Path) -> subprocess.CompletedProcess[str]:
    """As `make docs` does."""
    (command,) = re.findall(r"\$\(BIN\)/python (-m sphinx .*) \. build/docs\n", (ROOT / "Makefile").read_text())
    words = command.replace("build/doctrees", str(out / "doctrees")).replace("--conf-dir docs", f"--conf-dir {DOCS}").split()
    return subprocess.run(
        [sys.executable, *words, str(source), str(out / "site")], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("docs")
    done = build(ROOT, out)
    assert done.returncode == 0, done.stderr
    return out / "site"


class Page(HTMLParser):
    """`taken`: what a browser fetches for it; `links`: where it leads; `names`: the places within it; `text`: what is read."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.taken: list[str] = []
        self.links: list[str] = []
        self.names: set[str] = set()
        self.text = ""
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        given = dict(attributes)
        leads = tag == "link" and given.get("rel") in ("next", "prev", "index", "search")
        self.taken += [value for value in [given.get(TAKEN.get(tag, ""))] if value and not leads]
        self.links += [value for value in [given.get("href") if tag == "a" else None] if value]
        self.names |= {value for value in [given.get("id")] if value}

    def handle_data(self, data: str) -> None:
        self.text += data


def test_every_document_is_on_the_site_and_every_link_leads_somewhere(site: Path) -> None:
    """Beyond what the tool says itself: its answer, page by page, as a browser would take it."""
    pages = {path.resolve(): Page(path) for path in site.rglob("*.html")}
    named = {path.relative_to(site.resolve()).with_suffix(".md") for path in pages}
    wanted = {path.relative_to(ROOT) for path in DOCUMENTS} - {Path("README.md")}  # docs/index.md is the site's
    assert wanted <= named
    assert len(pages) > len(wanted)
    for path, page in pages.items():
        for link in page.links:
            if re.match(r"[a-z]+:", link):
                continue
            target, _, name = unquote(link).partition("#")
            there = (path.parent / target).resolve() if target else path
            assert there.is_file(), f"{path.relative_to(site.resolve())}: {link}"
            if name and there in pages:
                assert name in pages[there].names, f"{path.relative_to(site.resolve())}: {link}"


def test_nothing_is_fetched_from_elsewhere(site: Path) -> None:
    """Neither by a page nor by a style: the site is read without a network."""
    for path in site.rglob("*.html"):
        assert [address for address in Page(path).taken if re.match("(https?:)?//", address)] == [], path.name
    for path in site.rglob("*.css"):
        assert re.findall(r"(?:url\(|@import)\s*['\"]?(?:https?:)?//", path.read_text("utf-8")) == [], path.name


def test_the_lines_of_the_equations_are_where_it_says(site: Path) -> None:
    """Eight equations; a line that is named begins what it is said to begin."""
    rows = re.findall(r"(?m)^\| \((\d)\)(?: to \((\d)\))?", (DOCS / "paper.md").read_text())
    assert {number for first, last in rows for number in range(int(first), int(last or first) + 1)} == set(range(1, 9))
    links = re.findall(r"\[`([\w.]+)`\]\(\.\./([\w/]+\.py)\)", (DOCS / "paper.md").read_text())
    said = re.findall(r"([\w.]+), (\w+\.py) line (\d+)", Page(site / "docs" / "paper.html").text)
    assert len(links) == len(said) > 25
    for (symbol, path), (shown, file, number) in zip(links, said, strict=True):
        assert (symbol, Path(path).name) == (shown, file)
        line = (ROOT / path).read_text().splitlines()[int(number) - 1]
        name = symbol.rpartition(".")[2]
        assert re.match(rf"\s*((def|class) {name}\b|([A-Z_, ]+, )?{name}\b.*=)", line), line


def test_fields_are_told_with_their_units(site: Path) -> None:
    """Docstrings, and the comments of fields; of each class that the client's module offers."""
    text = Page(site / "docs" / "api.html").text
    for name in client.__all__:
        assert f"echogrid.client.{name}" in text
    for unit in ("m, of the rear axle’s centre", "rad, counter-clockwise, within (-pi, pi]", "m/s, d(range)/dt: positive is receding"):
        assert unit in text


def test_what_is_broken_fails(tmp_path: Path) -> None:
    """A page, a place on a page, a symbol, a file of code and a picture that are not there, each on a page of its own."""
    broken = {
        "[gone](gone.md)": "'gone.md'",
        "[gone](#gone)": "'gone'",
        "[`gone`](here.py)": "`gone` is not in here.py",
        "[`gone`](gone.py)": "`gone` is not in gone.py",
        "![gone](gone.png)": "gone.png",
    }
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "here.py").write_text("def here(): ...\n")
    sound = "```{toctree}\n:glob:\n*\n```\n"
    (tmp_path / "docs" / "index.md").write_text(f"# A page\n\n[`here`](here.py)\n\n{sound}")
    for number, text in enumerate(broken):
        (tmp_path / "docs" / f"page{number}.md").write_text(f"# A page\n\n{text}\n")
    done = build(tmp_path, tmp_path / "out")
    assert done.returncode != 0
    for number, complaint in enumerate(broken.values()):
        assert any(f"page{number}" in line and complaint in line for line in done.stderr.splitlines()), done.stderr
    assert "index.md" not in done.stderr
