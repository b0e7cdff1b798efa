"""Reads one YAML document strictly, keeping line numbers, and writes plain data that reads back to the same data.

The tree is built from the parser's events rather than by a YAML loader: no object is ever constructed, depth and size
stay bounded, and every place knows its line. Unquoted words mean what the YAML 1.2 core schema says: PyYAML follows
1.1, in which 1e5 is text, yes is true, 1:30 is ninety and 010 is eight; here 1e5 is a number, yes, 1:30 and dates are
text, 010 is ten.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import yaml

from workbench.core.errors import InputError
from workbench.core.input_file import read_input

Place = tuple[str | int, ...]


@dataclass(frozen=True)
class Document:
    """`data` is made of dict, list, str, int, float, bool and None; `lines` maps a place,
    such as ("runs", 2, "payload_kg"), to its line, counted from 1."""

    file: Path
    data: object
    lines: Mapping[Place, int]

    def line(self, place: Place) -> int | None:
        """The line of a place, or of the nearest block around it."""
        for end in range(len(place), -1, -1):
            if place[:end] in self.lines:
                return self.lines[place[:end]]
        return None


def dotted(place: Place) -> str:
    """("runs", 2, "payload_kg") as runs[2].payload_kg."""
    text = ""
    for part in place:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if text else part
    return text


_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_HEX = re.compile(r"0x[0-9a-fA-F]{1,15}")
_OCTAL = re.compile(r"0o[0-7]{1,15}")
_INFINITE = re.compile(r"([-+]?)\.(inf|Inf|INF)")
_WORDS: dict[str, bool | None] = {
    "": None, "~": None, "null": None, "Null": None, "NULL": None,
    "true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False,
}  # fmt: skip
_LONGEST_INTEGER = 18  # digits; longer ones become a float, so that no text can cost unbounded time


def meaning(word: str) -> str | int | float | bool | None:
    """The value of an unquoted scalar."""
    if word in _WORDS:
        return _WORDS[word]
    if _INTEGER.fullmatch(word) and len(word) <= _LONGEST_INTEGER:
        return int(word)
    if _FLOAT.fullmatch(word):
        return float(word)
    if _HEX.fullmatch(word) or _OCTAL.fullmatch(word):
        return int(word, 0)
    if infinite := _INFINITE.fullmatch(word):
        return float(infinite[1] + "inf")
    if word in (".nan", ".NaN", ".NAN"):
        return float("nan")
    return word


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: object) -> bool:
        return True


def _text(dumper: yaml.SafeDumper, value: str) -> yaml.ScalarNode:
    # PyYAML quotes what YAML 1.1 would misread; what only the 1.2 reader takes for a number is quoted here.
    style = None if isinstance(meaning(value), str) else "'"
    return dumper.represent_scalar("tag:yaml.org,2002:str", value, style=style)


def _row(dumper: yaml.SafeDumper, values: tuple[object, ...]) -> yaml.SequenceNode:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", values, flow_style=True)


_Dumper.add_representer(str, _text)
_Dumper.add_representer(tuple, _row)


def dumps(data: Mapping[str, object]) -> str:
    """YAML text, keys in the order given, one key a line; a tuple in one line."""
    return str(yaml.dump(data, Dumper=_Dumper, sort_keys=False, default_flow_style=False, width=10_000))


MAX_DEPTH = 40
MAX_VALUES = 200_000
_Loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
_PLAIN_TAGS = {None, "!", "tag:yaml.org,2002:str", "tag:yaml.org,2002:map", "tag:yaml.org,2002:seq"}


def load(path: str | os.PathLike[str]) -> Document:
    """Reads a YAML file. InputError names file and line of whatever is wrong with it."""
    file = Path(path)
    content = read_input(file, "settings")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise InputError(f"byte 0x{content[error.start]:02x} is not UTF-8 text", file=file, line=line) from error
    return loads(text, file)


def loads(text: str, file: str | os.PathLike[str]) -> Document:
    """Reads YAML from text; `file` only names it in errors."""
    builder = _Builder(Path(file), text)
    try:
        root = builder.document()
    except yaml.YAMLError as error:
        raise _syntax_error(error, Path(file), text) from error
    lines: dict[Place, int] = {(): root.line}
    data = builder.plain(root, (), lines)
    return Document(Path(file), data, lines)


@dataclass(frozen=True)
class _Node:
    """A scalar's value, a list's items or a mapping's (key, line of the key, value)s."""

    line: int
    value: str | int | float | bool | None = None
    items: tuple[_Node, ...] | None = None
    entries: tuple[tuple[str, int, _Node], ...] | None = None


class _Builder:
    def __init__(self, file: Path, text: str):
        self.file = file
        self.events: Iterator[yaml.Event] = iter(yaml.parse(text, Loader=_Loader))
        self.anchors: dict[str, _Node] = {}
        self.nodes = 0
        self.values = 0

    def fail(self, problem: str, line: int, place: str | None = None) -> InputError:
        return InputError(problem, file=self.file, line=line, place=place)

    def document(self) -> _Node:
        next(self.events)  # stream start
        event = next(self.events)
        if isinstance(event, yaml.StreamEndEvent):
            raise InputError("is empty", file=self.file)
        root = self.node(next(self.events), 0)
        next(self.events)  # document end
        event = next(self.events)
        if not isinstance(event, yaml.StreamEndEvent):
            raise self.fail("a second document starts here; expected one", _line(event))
        return root

    def node(self, event: yaml.Event, depth: int) -> _Node:
        line = _line(event)
        self.nodes += 1  # counted before anything is built of it
        if self.nodes > MAX_VALUES:
            raise self.fail(f"holds more than {MAX_VALUES} values", line)
        if depth > MAX_DEPTH:
            raise self.fail(f"is nested more than {MAX_DEPTH} deep", line)
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in self.anchors:
                raise self.fail(f"alias *{event.anchor} stands for nothing above it", line)
            return self.anchors[event.anchor]
        tag, anchor = getattr(event, "tag", None), getattr(event, "anchor", None)
        if tag not in _PLAIN_TAGS:
            raise self.fail(f"tag '{tag}' is not accepted; write the plain value", line)
        if isinstance(event, yaml.ScalarEvent):
            node = _Node(line, value=meaning(event.value) if event.implicit[0] else event.value)
        elif isinstance(event, yaml.SequenceStartEvent):
            items = []
            while not isinstance(inner := next(self.events), yaml.SequenceEndEvent):
                items.append(self.node(inner, depth + 1))
            node = _Node(line, items=tuple(items))
        else:
            node = _Node(line, entries=self.mapping(depth))
        if anchor is not None:
            self.anchors[anchor] = node
        return node

    def mapping(self, depth: int) -> tuple[tuple[str, int, _Node], ...]:
        entries: list[tuple[str, int, _Node]] = []
        seen: dict[str, int] = {}
        while not isinstance(event := next(self.events), yaml.MappingEndEvent):
            line = _line(event)
            if not isinstance(event, yaml.ScalarEvent):
                raise self.fail("a key must be a plain word", line)
            key = event.value
            if key == "<<":
                raise self.fail("merge keys (<<) are not accepted; write the keys out", line)
            if key in seen:
                raise self.fail(f"key '{key}' is doubled; it stands on line {seen[key]} already", line)
            seen[key] = line
            entries.append((key, line, self.node(next(self.events), depth + 1)))
        return tuple(entries)

    def plain(self, node: _Node, place: Place, lines: dict[Place, int]) -> object:
        """Plain data of a node. Aliases are written out here, which is where a bomb would go off."""
        self.values += 1
        if self.values > MAX_VALUES:
            raise self.fail(f"holds more than {MAX_VALUES} values (aliases written out)", node.line)
        if len(place) > MAX_DEPTH:
            raise self.fail(f"is nested more than {MAX_DEPTH} deep", node.line, dotted(place[:3]))
        if node.items is not None:
            for index, item in enumerate(node.items):
                lines[(*place, index)] = item.line
            return [self.plain(item, (*place, index), lines) for index, item in enumerate(node.items)]
        if node.entries is not None:
            for key, line, _ in node.entries:
                lines[(*place, key)] = line
            return {key: self.plain(value, (*place, key), lines) for key, _, value in node.entries}
        return node.value


def _line(event: yaml.Event) -> int:
    mark = event.start_mark
    return 1 if mark is None else mark.line + 1


def _syntax_error(error: yaml.YAMLError, file: Path, text: str) -> InputError:
    """The parser's complaint as one line, with a hint where a tab is to blame."""
    if isinstance(error, yaml.MarkedYAMLError) and error.problem_mark is not None:
        number = error.problem_mark.line
        rows = text.splitlines()
        problem = f"is not YAML: {error.problem}"
        if number < len(rows) and "\t" in rows[number]:
            problem += "; the line holds a tab, indent with spaces"
        return InputError(problem, file=file, line=min(number + 1, max(len(rows), 1)))
    if isinstance(error, yaml.reader.ReaderError):
        position = error.position if isinstance(error.position, int) else 0
        line = text[:position].count("\n") + 1
        return InputError(f"is not YAML: {error.reason} (0x{_code(error.character):02x})", file=file, line=line)
    return InputError(f"is not YAML: {str(error).splitlines()[0]}", file=file)


def _code(character: object) -> int:
    return character if isinstance(character, int) else ord(str(character)[:1] or "\0")
