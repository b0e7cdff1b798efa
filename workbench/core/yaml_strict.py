"""Strict YAML: plain data with a line number for every place, its record, and one-line errors for what does not fit.

The tree is built from the parser's events rather than by a YAML loader: no object is ever constructed, depth and size
stay bounded, and every place knows its line. Unquoted words mean what the YAML 1.2 core schema says: PyYAML follows
1.1, in which 1e5 is text, yes is true, 1:30 is ninety and 010 is eight; here 1e5 is a number, yes, 1:30 and dates are
text, 010 is ten.
"""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ValidationError

from workbench.core.errors import InputError, nearest
from workbench.core.input_file import read_input

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo
    from pydantic_core import ErrorDetails

Place = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)
Beside = Callable[[Place], set[str]]
MAX_DEPTH = 40
MAX_VALUES = 200_000
MAX_PROBLEMS = 5


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

    def block(self, name: str) -> Document | None:
        """A block of the file, as a document of its own; None where it has none of that name."""
        data = self.data.get(name) if isinstance(self.data, dict) else None
        lines = {place[1:]: line for place, line in self.lines.items() if place[:1] == (name,)}
        return Document(self.file, data, lines) if isinstance(data, dict) else None


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
    """A scalar's value, a list's items or a mapping's key -> (line of the key, value)."""

    line: int
    value: str | int | float | bool | list[_Node] | dict[str, tuple[int, _Node]] | None


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
        if isinstance(next(self.events), yaml.StreamEndEvent):
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
            node = _Node(line, meaning(event.value) if event.implicit[0] else event.value)
        elif isinstance(event, yaml.SequenceStartEvent):
            node = _Node(line, [self.node(e, depth + 1) for e in iter(self.next_inside, None)])
        else:
            node = _Node(line, self.mapping(depth))
        if anchor is not None:
            self.anchors[anchor] = node
        return node

    def next_inside(self) -> yaml.Event | None:
        """The next event of a list or mapping; None at its end."""
        event = next(self.events)
        return None if isinstance(event, yaml.CollectionEndEvent) else event

    def mapping(self, depth: int) -> dict[str, tuple[int, _Node]]:
        entries: dict[str, tuple[int, _Node]] = {}
        for event in iter(self.next_inside, None):
            line = _line(event)
            if not isinstance(event, yaml.ScalarEvent):
                raise self.fail("a key must be a plain word", line)
            key = event.value
            if key == "<<":
                raise self.fail("merge keys (<<) are not accepted; write the keys out", line)
            if key in entries:
                raise self.fail(f"key '{key}' is doubled; it stands on line {entries[key][0]} already", line)
            entries[key] = line, self.node(next(self.events), depth + 1)
        return entries

    def plain(self, node: _Node, place: Place, lines: dict[Place, int]) -> object:
        """Plain data of a node. Aliases are written out here, which is where a bomb would go off."""
        self.values += 1
        if self.values > MAX_VALUES:
            raise self.fail(f"holds more than {MAX_VALUES} values (aliases written out)", node.line)
        if len(place) > MAX_DEPTH:
            raise self.fail(f"is nested more than {MAX_DEPTH} deep", node.line, dotted(place[:3]))
        if isinstance(node.value, list):
            lines |= {(*place, index): item.line for index, item in enumerate(node.value)}
            return [self.plain(item, (*place, index), lines) for index, item in enumerate(node.value)]
        if isinstance(node.value, dict):
            lines |= {(*place, key): line for key, (line, _) in node.value.items()}
            return {key: self.plain(value, (*place, key), lines) for key, (_, value) in node.value.items()}
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


# Records


_BOUNDS = {
    "greater_than": ("gt", "greater than"),
    "greater_than_equal": ("ge", "of at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "of at most"),
}


def validate(model: type[Model], document: Document) -> Model:
    """The record a document describes; InputError with file:line: place: problem for up to five problems."""
    try:
        return model.model_validate(document.data)
    except ValidationError as error:
        raise together(
            InputError(text, file=document.file, line=document.line(place), place=dotted(place) or None)
            for place, text in problem_lines(model, error, document.data)
        ) from error


def together(errors: Iterable[InputError]) -> InputError:
    """Several problems as one error, which stands where the first one does."""
    first, *rest = errors
    text = "; ".join([first.problem, *map(str, rest)])
    return InputError(text, file=first.file, line=first.line, place=first.place)


def checked(model: type[Model], data: dict[str, Any]) -> Model:
    """The record of plain values. InputError names the first key that does not fit."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        place, problem = problem_lines(model, error, data)[0]
        raise InputError(problem, place=dotted(place) or None) from error


def put(data: dict[str, Any], path: Place, value: Any) -> None:
    """Set a value in blocks of blocks, which are made where there are none. What was a whole number stays one."""
    *inner, last = path
    block: Any = data
    for part in inner:
        if block.get(part) is None:
            block[part] = {}
        block = block[part]
    was_whole = isinstance(block.get(last), int) and not isinstance(block[last], bool)
    block[last] = int(value) if was_whole and isinstance(value, float) and value.is_integer() else value


def problem_lines(
    model: type[BaseModel], error: ValidationError, data: object, beside: Beside | None = None
) -> list[tuple[Place, str]]:
    """(place, sentence) of each problem, unknown keys first: they often explain what is missing.

    beside: the keys that whoever wrote the key at a place has written beside it; without it all of its block.
    """
    # Only what is shown is worded: a file of junk may hold a problem in every line.
    details = sorted(error.errors(include_url=False), key=lambda detail: detail["type"] != "extra_forbidden")
    shown: dict[tuple[Place, str], None] = {}
    more: set[tuple[Place, str]] = set()
    lists = set[str]()  # of valid keys: one that has been said is not said again
    for detail in details:
        place = _place_in(data, detail["loc"], missing=detail["type"] == "missing")
        if len(shown) == MAX_PROBLEMS:
            more.add((place, detail["type"]))
            continue
        text = _sentence(model, place, detail, beside or (lambda p: _present(data, p[:-1])))
        said, _, valid = text.partition("; valid: ")
        shown[(place, said if valid in lists else text)] = None
        lists.add(valid)
    problems = list(shown)
    if more:
        place, text = problems[-1]
        problems[-1] = (place, f"{text} (and {len(more)} more problem{'s' if len(more) > 1 else ''})")
    return problems


def _place_in(data: object, location: tuple[int | str, ...], *, missing: bool) -> Place:
    """Pydantic's location without the names it adds for the members of a union; with that of a missing key."""
    place: list[str | int] = []
    for index, part in enumerate(location):
        inside = (isinstance(data, dict) and part in data) or (
            isinstance(data, list) and isinstance(part, int) and part < len(data)
        )
        if inside:
            data = data[part]  # type: ignore[index]
            place.append(part)
        elif missing and isinstance(data, dict) and index == len(location) - 1:
            place.append(part)
    return tuple(place)


def _sentence(model: type[BaseModel], place: Place, detail: ErrorDetails, beside: Beside) -> str:
    kind, value, context = detail["type"], detail.get("input"), detail.get("ctx", {})
    if kind == "extra_forbidden":
        if str(place[-1]).isdigit():  # {speed_m_s: 0,7}
            return f"unknown key '{place[-1]}'; is it what stands behind a decimal comma?"
        all_keys = _keys(_models_at(model, place[:-1]), str(place[-1]))
        free = all_keys - beside(place)  # a key that is there already is hardly the one meant
        return f"unknown key '{place[-1]}'; {nearest(str(place[-1]), free or all_keys)}"
    if kind == "missing":
        return f"is missing; expected {_expectation(field_at(model, place))}"
    if kind in _BOUNDS:
        if (bounds := bounds_of(field_at(model, place))) is not None:
            return f"{_shown(value)}, expected {bounds.words(value)}"
        name, words = _BOUNDS[kind]
        return f"{_shown(value)}, expected a number {words} {_shown(context.get(name))}"
    if kind == "finite_number":
        return f"{_shown(value)}, expected a finite number"
    if kind.startswith(("float_", "int_")):
        whole = "a whole number" if kind.startswith("int_") else "a number"
        return f"{_shown(value)}, expected {whole}{_number_hint(value)}"
    if kind.startswith("bool_"):
        return f"{_shown(value)}, expected true or false"
    if kind == "string_type":
        hint = "; put it in quotes" if isinstance(value, int | float) else ""
        return f"{_shown(value)}, expected text{hint}"
    if kind == "literal_error":
        choices = [str(choice) for choice in _choices(field_at(model, place))]
        if isinstance(value, str) and difflib.get_close_matches(value, choices, n=1):
            return f"{_shown(value)}; {nearest(value, choices)}"
        return f"{_shown(value)}, expected {context.get('expected', ' or '.join(choices))}"
    if kind in ("model_type", "model_attributes_type", "dict_type", "mapping_type"):
        return f"{_shown(value)}, expected a block of keys"
    if kind in ("list_type", "tuple_type"):
        return f"{_shown(value)}, expected a list"
    if kind == "value_error":
        return str(context.get("error", detail["msg"]))
    message = detail["msg"]
    return f"{_shown(value)}: {message[:1].lower()}{message[1:]}"


def _shown(value: object) -> str:
    if value is None:
        return "empty"
    text = repr(value) if not isinstance(value, dict | list) else ("a block of keys" if value else "nothing")
    text = "a list" if isinstance(value, list) else text
    return text if len(text) <= 60 else text[:57] + "…"


def _number_hint(value: object) -> str:
    if not isinstance(value, str):
        return ""
    if re.fullmatch(r"\s*[-+]?[0-9]+,[0-9]+\s*", value):
        return " with a decimal point"
    try:
        float(value.replace("_", ""))
    except ValueError:
        return "; units belong to the key's name" if re.match(r"\s*[-+.]?[0-9]", value) else ""
    return " without quotes or underscores"


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]


def _models_at(model: type[BaseModel], place: Place) -> list[type[BaseModel]]:
    models = [model]
    for part in place:
        fields = [m.model_fields[part] for m in models if isinstance(part, str) and part in m.model_fields]
        if fields:
            models = [inner for field in fields for inner in _models_in(field.annotation)]
    return models


def field_at(model: type[BaseModel], place: Place) -> FieldInfo | None:
    """The field that a key of a file is read into, None for a key that is none."""
    for record in _models_at(model, place[:-1]):
        if place and isinstance(place[-1], str) and place[-1] in record.model_fields:
            return record.model_fields[place[-1]]
    return None


def _keys(models: list[type[BaseModel]], meant: str = "rad") -> set[str]:
    """Keys of a block; those of another unit only where the misspelt one speaks of radians."""
    return {
        field.alias or name
        for model in models
        for name, field in model.model_fields.items()
        if "rad" in meant or not any(getattr(mark, "other_unit", False) for mark in field.metadata)
    }


def _present(data: object, place: Place) -> set[str]:
    for part in place:
        data = data[part]  # type: ignore[index]
    return {str(key) for key in data} if isinstance(data, dict) else set()


def _choices(field: FieldInfo | None) -> tuple[Any, ...]:
    return get_args(field.annotation) if field is not None else ()


def _expectation(field: FieldInfo | None) -> str:
    """The expected value of a field, from its declaration."""
    if field is None:
        return "a value"
    if models := _models_in(field.annotation):
        return f"a block with {', '.join(sorted(_keys(models)))}"
    if field.annotation is str:
        return "text"
    if (bounds := bounds_of(field)) is not None:
        return bounds.words()
    if field.annotation in (float, int):
        words = [
            f"{text} {_shown(getattr(bound, name))}"
            for bound in field.metadata
            for name, text in _BOUNDS.values()
            if getattr(bound, name, None) is not None
        ]
        return " ".join(["a whole number" if field.annotation is int else "a number", " and ".join(words)]).strip()
    choices = [repr(choice) for choice in _choices(field) if isinstance(choice, str | int)]
    return " or ".join(choices) or "a value"


@dataclass(frozen=True)
class Bounds:
    """Of a quantity; because: reason and hint, as `workbench.core.record` declares them."""

    lowest: float
    highest: float
    because: Any

    def words(self, value: Any = 0.0) -> str:
        """What is expected; no more than the sign, unless the value goes beyond what only a slip does."""
        if self.lowest >= 0.0 and value <= 0.0:
            return "a number greater than 0" if self.lowest > 0.0 else "a number of at least 0"
        if not value:
            return "a number"
        hint = self.because.hint
        return f"a number from {self.lowest:g} to {self.highest:g}" + (f"; {hint}" if hint else "")


def bounds_of(field: FieldInfo | None) -> Bounds | None:
    """A field's bounds if they are declared with their reason, otherwise None."""
    if field is None:
        return None
    for marks in [field.metadata, *(getattr(part, "__metadata__", ()) for part in get_args(field.annotation))]:
        if because := [mark for mark in marks if hasattr(mark, "reason")]:
            flat = [inner for mark in marks for inner in getattr(mark, "metadata", [mark])]
            low, high = (next(b for m in flat if (b := getattr(m, name, None)) is not None) for name in ("ge", "le"))
            return Bounds(low, high, because[0])
    return None
