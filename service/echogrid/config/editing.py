"""Changes a few values of a TOML text and leaves the rest, comments too, as it was."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

Path = tuple[str | int, ...]  # ("radar", 1, "yaw_deg"), or ("detections", "azimuth", "sign")
HEADER = re.compile(r"\s*(\[\[?)\s*([^\]]+?)\s*\]\]?\s*(#.*)?$")


def edited(text: str, changes: Mapping[Path, Any]) -> str:
    """The text with other values, new ones where a key is missing.

    Line by line where that gives what is meant, else the whole file without its comments. Raises ValueError where the text is no TOML.
    """
    wanted = tomllib.loads(text)
    for path, value in changes.items():
        _set(wanted, path, value)
    lines = text.splitlines()
    for path, value in changes.items():
        _change(lines, path, value)
    changed = "\n".join(lines) + "\n"
    try:
        if tomllib.loads(changed) == wanted:
            return changed
    except tomllib.TOMLDecodeError:
        pass
    return written(wanted)


def written(document: Mapping[str, Any]) -> str:
    """A document as TOML: its plain values, then its tables and lists of tables, which hold plain values and inline tables alone."""
    lines = [f"{key} = {literal(value)}" for key, value in document.items() if not _is_table(value)]
    for key, value in document.items():
        for table in value if isinstance(value, list) and _is_table(value) else [value] if _is_table(value) else []:
            lines += ["", f"[[{key}]]" if isinstance(value, list) else f"[{key}]"]
            lines += [f"{name} = {literal(inner)}" for name, inner in table.items()]
    return "\n".join(lines) + "\n"


def literal(value: Any) -> str:
    """A value as TOML on one line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {literal(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, Sequence):
        return "[" + ", ".join(literal(inner) for inner in value) + "]"
    return repr(value)


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and all(isinstance(one, dict) for one in value))


def _set(document: Any, path: Path, value: Any) -> None:
    for key in path[:-1]:
        document = document.setdefault(key, {}) if isinstance(document, dict) else document[key]
    document[path[-1]] = value


def _change(lines: list[str], path: Path, value: Any) -> None:
    """One value in place: of a key at the top, in a table or the n-th of a list of tables, or in an inline table there."""
    table, index = (str(path[0]) if len(path) > 1 else "", path[1] if len(path) > 2 and isinstance(path[1], int) else None)
    rest = path[(2 if index is not None else 1) if table else 0 :]
    first, end = _table(lines, table, index)
    if first is None:
        lines += ["", f"[{table}]", f"{rest[0]} = {literal(value)}"]
        return
    at = next((n for n in range(first, end) if re.match(rf"\s*{re.escape(str(rest[0]))}\s*=", lines[n])), None)
    if at is None:
        while end > first and not lines[end - 1].strip():
            end -= 1
        lines.insert(end, f"{rest[0]} = {literal(value)}")
    elif len(rest) == 1:
        name, _, old = lines[at].partition("=")
        lines[at] = f"{name.rstrip()} = {literal(value)}{_comment(old)}"
    else:
        lines[at] = _inline(lines[at], str(rest[1]), literal(value))


def _table(lines: list[str], table: str, index: int | None) -> tuple[int | None, int]:
    """The first line of a table's body, None where there is none, and the line after its last."""
    heads = [(n, found[2]) for n, line in enumerate(lines) if (found := HEADER.match(line))]
    ends = [n for n, _ in heads[1:]] + [len(lines)]
    if not table:
        return 0, heads[0][0] if heads else len(lines)
    bodies = [(n + 1, end) for (n, name), end in zip(heads, ends, strict=True) if name == table]
    number = index or 0
    return bodies[number] if number < len(bodies) else (None, len(lines))


def _comment(old: str) -> str:
    """What follows a value on its line."""
    found = re.match(r"""\s*(?:"(?:[^"\\]|\\.)*"|'[^']*'|[^#"']*?)(\s*#.*)?$""", old)
    return (found[1] or "") if found else ""


def _inline(line: str, key: str, value: str) -> str:
    """With another value of one key of the inline table on a line, or with that key added."""
    present = re.compile(rf"(?<![\w-])({re.escape(key)}\s*=\s*)(\"[^\"]*\"|[^,}}\s]+)")
    if present.search(line):
        return present.sub(lambda found: found[1] + value, line, count=1)
    return (
        re.sub(r"\s*\}", f", {key} = {value} }}", line, count=1) if line.count("}") == 1 else line.replace("{", f"{{ {key} = {value},", 1)
    )
