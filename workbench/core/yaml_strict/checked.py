"""Plain data to a pydantic record, with one-line errors for what does not fit."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from workbench.core.errors import InputError, nearest
from workbench.core.yaml_strict.reader import Document, Place, dotted

if TYPE_CHECKING:
    from pydantic.fields import FieldInfo
    from pydantic_core import ErrorDetails

Model = TypeVar("Model", bound=BaseModel)
Beside = Callable[[Place], set[str]]
MAX_PROBLEMS = 5
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
        problems = problem_lines(model, error, document.data)
        lines = [
            InputError(text, file=document.file, line=document.line(place), place=dotted(place) or None)
            for place, text in problems
        ]
        first = lines[0]
        rest = [str(line) for line in lines[1:]]
        raise InputError(
            "; ".join([first.problem, *rest]), file=first.file, line=first.line, place=first.place
        ) from error


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
    for detail in details:
        place = _place_in(data, detail["loc"], missing=detail["type"] == "missing")
        if len(shown) == MAX_PROBLEMS:
            more.add((place, detail["type"]))
            continue
        shown[(place, _sentence(model, place, detail, beside or (lambda p: _present(data, p[:-1]))))] = None
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
        all_keys = _keys(_models_at(model, place[:-1]), str(place[-1]))
        free = all_keys - beside(place)  # a key that is there already is hardly the one meant
        return f"unknown key '{place[-1]}'; {nearest(str(place[-1]), free or all_keys)}"
    if kind == "missing":
        return f"is missing; expected {_expectation(_field_at(model, place))}"
    if kind in _BOUNDS:
        if (bounds := bounds_of(_field_at(model, place))) is not None:
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
        choices = [str(choice) for choice in _choices(_field_at(model, place))]
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
        fields = [
            record.model_fields[part] for record in models if isinstance(part, str) and part in record.model_fields
        ]
        if fields:
            models = [inner for field in fields for inner in _models_in(field.annotation)]
    return models


def _field_at(model: type[BaseModel], place: Place) -> FieldInfo | None:
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
