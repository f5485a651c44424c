"""How these documents become a site, with Sphinx: `make docs`. They are read where they lie: their links hold in a checkout too."""

from __future__ import annotations

import ast
import inspect
import pydoc
import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util import logging

ROOT = Path(__file__).parents[1]
LINK = re.compile(r"\[([^\[\]]+)\]\(([^()\s#:]+)\)")

project = "echogrid"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode"]
root_doc = "docs/index"
include_patterns = [
    "docs/*.md",
    "deploy/README.md",
    "dbc/README.md",
    "examples/README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "training/LOG.md",
]
exclude_patterns = [".*", "build", "dist", "out", "service", "tests"]  # not looked into
myst_heading_anchors = 4
html_title = "echogrid"
html_theme = "furo"  # light and dark, fonts of the machine, nothing from elsewhere
html_extra_path = ["site"]  # the address without a page
html_copy_source = False
html_use_index = False
html_show_sphinx = False
default_role = "code"  # of `names` in docstrings
autodoc_member_order = "bysource"
autodoc_default_options = {"undoc-members": True}


def as_on_the_site(app: Sphinx, name: str, source: list[str]) -> None:
    """Links into the code get what only the code knows: [`symbol`](file.py) its line. A link to a folder is text: a site has none."""
    page = Path(app.env.doc2path(name))

    def replaced(link: re.Match[str]) -> str:
        text, target = link[1], page.parent / link[2]
        if target.is_dir():
            return text
        if target.suffix != ".py" or not re.fullmatch(r"`[\w.]+`", text):
            return link[0]
        line = line_of(target, text.strip("`")) if target.is_file() else None
        if line is None:
            logging.getLogger(__name__).warning("%s is not in %s", text, link[2], location=name)
        return f"{link[0]}, {target.name} line {line}"

    source[0] = LINK.sub(replaced, source[0])


def line_of(path: Path, symbol: str) -> int | None:
    """Where a function, class, method or constant (`Class.method`) of a module begins."""
    body: list[ast.stmt] = ast.parse(path.read_text("utf-8")).body
    found: ast.stmt | None = None
    for part in symbol.split("."):
        found = next((statement for statement in body if part in names(statement)), None)
        body = found.body if isinstance(found, ast.ClassDef) else []
    return found.lineno if found else None


def names(statement: ast.stmt) -> set[str]:
    """What it defines."""
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return {statement.name}
    targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target] if isinstance(statement, ast.AnnAssign) else []
    return {node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)}


def comment_of_a_field(app: Sphinx, what: str, name: str, field: object, options: object, lines: list[str]) -> None:
    """A field of a dataclass has no docstring, but the comment at its line, with its unit and shape."""
    owner, _, own_name = name.rpartition(".")
    found = pydoc.locate(owner)
    if what != "attribute" or not isinstance(found, type):
        return
    own_line = re.compile(rf"(?m)^    {own_name}: [^#\n]*# (.*)$")
    for kind in found.__mro__[:-1]:
        comment = own_line.search(inspect.getsource(kind)) if kind.__module__.startswith("echogrid") else None
        if comment:
            lines[:] = [comment[1]]
            return


def setup(app: Sphinx) -> None:
    app.connect("source-read", as_on_the_site)
    app.connect("autodoc-process-docstring", comment_of_a_field)
