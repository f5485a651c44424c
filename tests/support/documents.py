"""The blocks of code in the documents: what a reader types, and programs to copy."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from tests.support.places import ROOT

DOCUMENTS = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(ROOT / folder / "README.md" for folder in ("dbc", "deploy", "examples")),
    *sorted((ROOT / "docs").glob("*.md")),
]
PROGRAMS = {
    "apt",
    "candump",
    "cd",
    "cp",
    "dask",
    "echogrid",
    "echogrid-train",
    "eval",
    "ip",
    "journalctl",
    "jupyter",
    "make",
    "networkctl",
    "openssl",
    "pip",
    "python",
    "python3",
    "source",
    "sudo",
    "sudoedit",
    "systemctl",
}
SHELLS = ("", "sh")  # languages of a block: none for an indented one
MARK = re.compile(r"<!-- not run((?:,? `[^`]+`)*): (.+?) -->")


@dataclass(frozen=True)
class Block:
    """A block of code; `marks`: by a word of its lines, or "" for all of them, why they are not run."""

    document: Path
    line: int  # of its first line, from 1
    language: str
    text: str
    marks: tuple[tuple[str, str], ...]

    @property
    def place(self) -> str:
        return f"{self.document.relative_to(ROOT)}:{self.line}"

    def commands(self) -> list[str]:
        """What is typed, without comments, lines that go on joined; in a transcript it stands behind "$ ". None in other blocks."""
        lines = re.sub(r"\\\n\s*", "", self.text).splitlines()
        if self.language == "text":
            lines = [line[2:] for line in lines if line.startswith("$ ")]
        elif self.language not in SHELLS or not any(tool(line) in PROGRAMS for line in lines):
            return []
        typed = [re.sub(r"(^| +)# .*", "", line).strip() for line in lines]
        return [command for command in typed if command]

    def why_not_run(self, command: str) -> str | None:
        """None where it is run."""
        return next((why for word, why in self.marks if word in command), None)


def tool(command: str) -> str:
    """Its name, without the folder in which a document says it lies."""
    return command.split(" ")[0].rpartition("/")[2]


def blocks(document: Path) -> list[Block]:
    """In their order."""
    lines, out, marks, at = document.read_text("utf-8").splitlines(), [], (), 0
    while at < len(lines):
        line = lines[at]
        fence, indented = re.fullmatch(r"```(\w+)?.*", line), line.startswith("    ") and (not at or not lines[at - 1].strip())
        if fence or indented:
            end = at + 1
            while end < len(lines) and (lines[end] != "```" if fence else lines[end].startswith("    ") or not lines[end].strip()):
                end += 1
            text = lines[at + 1 : end] if fence else [line[4:] for line in lines[at:end]]
            out.append(
                Block(document, at + 1 + bool(fence), (fence[1] or "text") if fence else "", "\n".join(text).strip("\n") + "\n", marks)
            )
            marks, at = (), end + bool(fence)
            continue
        found = MARK.fullmatch(line)
        if found:
            marks += tuple((word, found[2]) for word in re.findall("`([^`]+)`", found[1]) or [""])
        elif line.strip():
            marks = ()
        at += 1
    return out
