"""docs/site/made_pages.py, which stands outside the package, as a module."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

FILE = Path(__file__).resolve().parents[2] / "docs" / "site" / "made_pages.py"


def made_pages() -> Any:
    spec = importlib.util.spec_from_file_location("made_pages", FILE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
