"""What to say of a TOML file that declares a table or a key twice: its parser names neither the other place nor what is expected."""

from __future__ import annotations

import re
import tomllib

import msgspec.inspect

REFUSED = re.compile(r"Cannot (?:declare|overwrite|mutate) .*\(at (?:line (\d+)|end of document)")
HEADER = re.compile(r"\s*(\[\[?)[^\[\]]+\]")


def twice(text: str, said: str, kind: type) -> str | None:
    """The sentence, where that is why `text` is no `kind`; `said`: by the parser. None where it is not."""
    refused = REFUSED.match(said)
    if refused is None:
        return None
    lines = text.replace("\r\n", "\n").split("\n")
    number = int(refused[1] or len(lines))
    header = _header(lines[number - 1])
    if header is None:
        return f"line {number}: '{lines[number - 1].strip():.60}' found, but what it names is there already, expected once"
    keys, brackets = header
    name = ".".join(keys)
    several = _is_array(msgspec.inspect.type_info(kind), keys)
    expected = f"[[{name}]] each time: there may be several" if several else f"one [{name}]"
    for before in range(number - 1, 0, -1):
        other = _header(lines[before - 1])
        if other is not None and other[0] == keys and _parses("\n".join(lines[: before - 1])):  # else it stands in a text of several lines
            first = f"{other[1]}{name}{']' * len(other[1])}"
            return f"line {number}: {brackets}{name}{']' * len(brackets)} found, and {first} in line {before}, expected {expected}"
    return f"line {number}: {brackets}{name}{']' * len(brackets)} found, but '{name}' is there already as a key, expected {expected}"


def _header(line: str) -> tuple[list[str], str] | None:
    """The keys of a line that opens a table, and its brackets, [ or [[; None of another line."""
    opens = HEADER.match(line)
    if opens is None:
        return None
    try:
        inside: object = tomllib.loads(line)
    except ValueError:  # a line of an array's value
        return None
    keys: list[str] = []
    while isinstance(inside, dict) and inside:
        (key,) = inside
        keys.append(key)
        inside = inside[key]
    return keys, opens[1]


def _parses(text: str) -> bool:
    try:
        tomllib.loads(text)
    except ValueError:
        return False
    return True


def _is_array(info: msgspec.inspect.Type, keys: list[str]) -> bool:
    """Whether there may be several of the table under those keys."""
    if isinstance(info, msgspec.inspect.UnionType):
        return any(_is_array(one, keys) for one in info.types)
    if isinstance(info, msgspec.inspect.VarTupleType | msgspec.inspect.ListType):
        return not keys or _is_array(info.item_type, keys)
    if not keys or not isinstance(info, msgspec.inspect.StructType):
        return False
    return any(_is_array(field.type, keys[1:]) for field in info.fields if field.encode_name == keys[0])
