"""A block of machine.yaml that may be given by a name: `drive: ideal`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, BeforeValidator, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema


@dataclass(frozen=True, eq=False)
class _Named:
    """The name stands for the block, in the file and in its JSON schema."""

    blocks: Mapping[str, BaseModel]

    def block(self, value: Any) -> Any:
        if not isinstance(value, str):
            return value
        if value not in self.blocks:
            raise ValueError(f"'{value}', expected a block or one of {', '.join(self.blocks)}")
        return self.blocks[value].model_dump()

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        return {"anyOf": [{"enum": list(self.blocks)}, handler(core)]}


def by_name(blocks: Mapping[str, BaseModel]) -> tuple[Any, ...]:
    """What a field's annotation holds beside its type."""
    named = _Named(blocks)
    return BeforeValidator(named.block), named
