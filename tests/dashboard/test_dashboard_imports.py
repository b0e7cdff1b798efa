"""What a first visit waits for: no page imports what none of them needs."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("streamlit")

ROOT = Path(__file__).resolve().parents[2]
# Drawn in a process of its own, as a first visit does; what pandas costs is a third of the imports before it.
_DRAWN = """
import sys
from tests.support.dashboard_app import figures, page
app = page("Study").run()
assert not app.exception and len(figures(app)) == 2
heavy = ("pandas", "matplotlib", "control", "exudyn", "pymodbus", "asyncua", "scipy.stats", "scipy.signal")
print([name for name in heavy if name in sys.modules])
"""


def test_the_first_page_imports_nothing_heavy_that_it_does_not_show():
    done = subprocess.run([sys.executable, "-c", _DRAWN], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
