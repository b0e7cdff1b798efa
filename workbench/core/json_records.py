"""Records as JSON knows them: pydantic makes them plain, numbers get so many significant digits."""

from __future__ import annotations

import math
from typing import Any


def plain(record: Any, digits: int = 6) -> Any:
    """Mappings, lists, texts and numbers of a record, a mapping or an array, in their order.

    A float has `digits` significant digits; None stands for what is no finite number.
    """
    from pydantic_core import to_jsonable_python

    return _shortened(to_jsonable_python(record, fallback=_plain_array), digits)


def rounded(value: float, digits: int = 6) -> float | None:
    """A number with so many significant digits; None if it is not finite."""
    if not math.isfinite(value):
        return None
    shortened = float(f"{value:.{digits}g}")
    return shortened if math.isfinite(shortened) else float(value)  # beyond the largest float there is none


def _plain_array(array: Any) -> Any:
    """numpy's arrays and numbers; TypeError for anything else that pydantic does not know."""
    try:
        return array.tolist()
    except AttributeError:
        raise TypeError(f"a {type(array).__name__} has no form in JSON") from None


def _shortened(value: Any, digits: int) -> Any:
    if isinstance(value, float):
        return rounded(value, digits)
    if isinstance(value, dict):
        return {key: _shortened(item, digits) for key, item in value.items()}
    if isinstance(value, list):
        return [_shortened(item, digits) for item in value]
    return value
