"""JSON Schemas of the files that users write, from the records that read them."""

from __future__ import annotations

from functools import reduce
from operator import or_
from typing import Any

DIALECT = "https://json-schema.org/draft/2020-12/schema"
KINDS = ("scenario", "machine", "runs")


def json_schema(kind: str) -> dict[str, Any]:
    """The schema of one kind of file, for editors and other tools. kind: one of KINDS."""
    schema = {"scenario": _scenario, "machine": _machine, "runs": _runs}[kind]()
    return {"$schema": DIALECT} | schema | {"title": f"workbench {kind}"}


def _scenario() -> dict[str, Any]:
    from workbench.references import usual_kinds
    from workbench.study.scenario.record import Scenario

    schema = Scenario.model_json_schema()
    schema["properties"]["references"]["default"] = list(usual_kinds())
    # A file that extends another has what it needs from there; blocks are then filled from both.
    needed = schema.pop("required")
    schema["if"] = {"required": ["extends"]}
    schema["else"] = {"required": needed}
    forms = schema["$defs"]["PiSettings"], schema["$defs"]["LinearCascade"], schema["$defs"]["RotaryCascade"]
    gains = [form.pop("required") for form in forms]
    schema["properties"]["controller"]["anyOf"] = schema["properties"]["controller"].pop("oneOf")
    needs = [list(names) for names in dict.fromkeys(map(tuple, gains))]
    schema["else"]["properties"] = {"controller": {"anyOf": [{"required": names} for names in needs]}}
    return schema


def _machine() -> dict[str, Any]:
    from pydantic import TypeAdapter

    from workbench.machine.files import RECORDS

    union: Any = reduce(or_, RECORDS)
    schema = TypeAdapter(union).json_schema()
    # `kind` may be left out of the first only, and tells editors which form is meant.
    for name in (record.__name__ for record in RECORDS[1:]):
        record = schema["$defs"][name]
        record["required"] = [*record.get("required", ()), *(k for k in ("kind",) if k not in record["required"])]
    return schema


def _runs() -> dict[str, Any]:
    from workbench.logs.runs_file import RunsFile

    schema = RunsFile.model_json_schema()
    # `signal: column` is short for `signal: {column: column}`.
    columns = schema["properties"]["columns"]
    columns["additionalProperties"] = {"anyOf": [{"type": "string"}, columns["additionalProperties"]]}
    return schema
