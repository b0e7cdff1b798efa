"""Ctrl-C reaches what the tests start, whatever shell runs them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.skipif(os.name != "posix", reason="allowed: signals of POSIX")
def test_tests_and_their_children_hear_ctrl_c_though_the_shell_ignores_it():
    child = "import signal; print(signal.getsignal(signal.SIGINT) == signal.SIG_IGN)"
    code = f"import subprocess, sys, tests.conftest; subprocess.run([sys.executable, '-c', {child!r}], check=True)"
    ignoring = ["sh", "-c", 'trap "" INT; exec "$0" "$@"', sys.executable, "-c"]
    without = subprocess.run([*ignoring, child], cwd=ROOT, capture_output=True, text=True, check=True)
    with_it = subprocess.run([*ignoring, code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert (without.stdout.strip(), with_it.stdout.strip()) == ("True", "False")
    assert signal.getsignal(signal.SIGINT) != signal.SIG_IGN
