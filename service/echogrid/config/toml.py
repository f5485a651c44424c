"""TOML files into typed structs; every mistake is one sentence with file and key."""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from pathlib import Path
from typing import TypeVar

import msgspec
import msgspec.inspect

from echogrid.config.twice import twice
from echogrid.errors import EchogridError
from echogrid.files import read, surely

T = TypeVar("T")
MOST_BYTES = 1 << 20
KINDS = {"float": "a number", "int": "a whole number", "str": "a text", "bool": "true or false", "array": "an array", "object": "a table"}
# What a text is to look like, and the words for it.
WORD = "^[A-Za-z0-9_-]+$"  # of names that become parts of keys
NAMESPACE = "^(/|(/[A-Za-z_][A-Za-z0-9_]*)+)$"
SHA256 = "^[0-9a-f]{64}$"
PATTERNS = {
    WORD: "letters, digits, _ and - alone",
    NAMESPACE: "/, or names behind slashes such as /echogrid",
    SHA256: "64 digits from 0 to f",
}
NOTES = {"ros.distro": "; 'jazzy' stands for every distribution since Iron"}  # on choices that do not say it themselves


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A TOML table; a key that it does not know is an error."""


def load(path: Path, kind: type[T]) -> T:
    """The file as a `kind`. Raises EchogridError naming the file, the key, what was found and what was expected."""
    try:
        text = read(path, MOST_BYTES).decode("utf-8-sig")
    except EchogridError as error:
        raise EchogridError(f"{error}{_other(path)}") from error
    except UnicodeDecodeError as error:
        raise EchogridError(f"{path}: is not a text file (byte {error.start} is not UTF-8){_other(path)}") from error
    try:
        document = tomllib.loads(text, parse_float=_finite)
        nameless = _nameless(document)
    except RecursionError as error:
        raise EchogridError(f"{path}: tables or arrays are nested too deeply") from error
    except ValueError as error:  # TOMLDecodeError, and what Python says of endless numbers
        why = twice(text, str(error), kind) or f"is not valid TOML: {error}{_line(text, str(error))}{_other(path)}"
        raise EchogridError(f"{path}: {why}") from error
    if nameless is not None:
        raise EchogridError(f"{path}: {nameless}")
    try:
        return msgspec.convert(document, kind)
    except msgspec.ValidationError as error:
        raise EchogridError(f"{path}: {_mistaken(kind, document) or _sentence(str(error), kind, document)}") from error


def _mistaken(kind: type, document: dict[str, object]) -> str | None:
    """Where a profile was given for a configuration, or the other way round: what is said in place of its first key that does not fit."""
    wanted = msgspec.inspect.type_info(kind)
    is_profile = isinstance(wanted, msgspec.inspect.StructType) and wanted.tag_field == "kind"
    if is_profile and "kind" not in document and {"bus", "radar"} & document.keys():
        return "is a configuration, expected a profile, which begins with its kind"
    if not is_profile and "kind" in document and "bus" not in document:
        return f"is a profile of kind {document['kind']!r}, expected a configuration, which names it"
    return None


def _line(text: str, said: str) -> str:
    """What stands in the line that the parser names; nothing where it names none."""
    named = re.search(r"\(at line (\d+), column \d+\)$", said)
    if named is None:
        return ""
    line = text.replace("\r\n", "\n").split("\n")[int(named[1]) - 1].strip()[:60]
    return f": '{''.join(letter if letter.isprintable() else '?' for letter in line)}'"


def _other(path: Path) -> str:
    """The end of a sentence about a file that was given in place of a TOML file, such as a recording."""
    return "" if path.suffix == ".toml" or not surely(path.is_file) else ", expected a .toml file"


def _finite(text: str) -> float:
    """A number that can be reckoned with: nothing in our tables may be TOML's inf or nan."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"'{text}' is not a finite number")
    return number


def _nameless(document: object, at: str = "") -> str | None:
    """What to say of a text that is empty, which would be taken for none, or has a NUL, which no file and no channel has."""
    if isinstance(document, str):
        what = "a text with \\u0000" if "\0" in document else None if document else "an empty text"
        return what and f"{at}: {what} found, expected a name"
    inside = document.items() if isinstance(document, dict) else enumerate(document) if isinstance(document, list) else ()
    said = (_nameless(one, f"{at}[{key}]" if isinstance(document, list) else f"{at}.{key}".removeprefix(".")) for key, one in inside)
    return next((one for one in said if one is not None), None)


def _sentence(message: str, kind: type, document: object) -> str:
    """msgspec's "what - at `$.key`" turned round to "key: what", with what was found, and the nearest known key where one was mistyped."""
    what, _, where = message.partition(" - at ")
    key = where.strip("`").removeprefix("$").removeprefix(".")
    parts = re.findall(r"\w+", key)
    if re.match(r"Invalid (enum )?value", what):
        known = " or ".join(repr(choice) for choice in _choices(msgspec.inspect.type_info(kind), parts))
        what = f"{_at(document, parts)!r:.60} found, expected {known}{NOTES.get(key, '')}"
    elif what.startswith("Expected "):
        expected = what.removeprefix("Expected ").partition(", got ")[0]
        for pattern, words in PATTERNS.items():
            expected = expected.replace(f"`str` matching regex {pattern!r}", words)
        expected = re.sub(r"`(\w+)( \| null)?`", lambda kind: KINDS.get(kind[1], kind[1]), expected)
        found = _at(document, parts)
        what = f"{found!r:.60} found, expected {expected}"
        if expected == "an array" and isinstance(found, dict):
            what = f"[{key}] found, expected [[{key}]]: there may be several"
        if expected == "a table" and isinstance(found, list):
            what = f"[[{key}]] found, expected [{key}]: there is one"
    unknown = re.fullmatch(r"Object contains unknown field `(.*)`", what)
    if unknown:
        name, keys = unknown[1], _all_keys(kind)
        own = _keys_at(msgspec.inspect.type_info(kind), parts)
        near = difflib.get_close_matches(name, own, n=1) or difflib.get_close_matches(name, keys, n=1)
        guess = "; it is one of another table" if name in keys else f"; did you mean '{near[0]}'?" if near else ""
        what = f"unknown key '{name}'{guess}"
    missing = re.fullmatch(r"Object missing required field `(.*)`", what)
    if missing:
        what = f"the key '{missing[1]}' is missing"
    return f"{key}: {what}" if key else what


def _at(document: object, parts: list[str]) -> object:
    """What stands under a key."""
    for part in parts:
        document = document[int(part)] if isinstance(document, list) else document.get(part) if isinstance(document, dict) else document
    return document


def _choices(info: msgspec.inspect.Type, parts: list[str]) -> tuple[object, ...]:
    """The values that a key may have, where they can be counted."""
    if isinstance(info, msgspec.inspect.UnionType):
        return next((found for one in info.types if (found := _choices(one, parts))), ())
    if not parts:
        return info.values if isinstance(info, msgspec.inspect.LiteralType) else ()
    if isinstance(info, msgspec.inspect.StructType):
        if parts[0] == info.tag_field:
            return (info.tag,)
        return next((_choices(field.type, parts[1:]) for field in info.fields if field.encode_name == parts[0]), ())
    return _choices(info.item_type, parts[1:]) if isinstance(info, msgspec.inspect.VarTupleType | msgspec.inspect.ListType) else ()


def _keys_at(info: msgspec.inspect.Type, parts: list[str]) -> list[str]:
    """The keys of the table that stands under a key."""
    if isinstance(info, msgspec.inspect.UnionType):
        return next((found for one in info.types if (found := _keys_at(one, parts))), [])
    if isinstance(info, msgspec.inspect.VarTupleType | msgspec.inspect.ListType):
        return _keys_at(info.item_type, parts[1:])
    if not isinstance(info, msgspec.inspect.StructType):
        return []
    if not parts:
        return [field.encode_name for field in info.fields]
    return next((_keys_at(field.type, parts[1:]) for field in info.fields if field.encode_name == parts[0]), [])


def _all_keys(kind: object, seen: frozenset[object] = frozenset()) -> set[str]:
    """Keys of a struct and of all structs inside it."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        if kind in seen:
            return set()
        keys: set[str] = set()
        for field in msgspec.structs.fields(kind):
            keys |= {field.encode_name} | _all_keys(field.type, seen | {kind})
        return keys
    return set().union(*(_all_keys(inner, seen) for inner in getattr(kind, "__args__", ())))
