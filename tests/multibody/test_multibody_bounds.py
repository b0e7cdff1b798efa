"""What the multi-body package may know, and what it says where it cannot work."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from workbench.core.errors import InputError
from workbench.effects.registry import find
from workbench.machines import default_hoist
from workbench.machines.multibody import switches_of
from workbench.machines.multibody.switches import _EFFECTS, engine

OWN = ("workbench.core.", "workbench.machines.multibody.")
PACKAGE = Path(__file__).resolve().parents[2] / "workbench" / "machines" / "multibody"
MACHINE = default_hoist()


def test_it_shares_no_equation_with_the_lumped_plant():
    allowed = {
        "workbench.core.errors.InputError",
        "workbench.core.run.Array",
        "workbench.core.run.Run",
        "workbench.machines.Hoist",
    }
    for module in sorted(PACKAGE.glob("*.py")):
        for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
            names = [f"{node.module}.{alias.name}" for alias in node.names] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                if name.startswith("workbench") and not name.startswith(OWN):
                    assert name in allowed, f"{module.name}: {name}"


def test_importing_it_does_not_load_the_engine():
    code = "import sys, workbench.machines.multibody; print([m for m in sys.modules if m == 'exudyn'])"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=PACKAGE.parents[2], capture_output=True, text=True, check=True
    )
    assert ast.literal_eval(done.stdout) == []


def test_without_the_extra_one_line_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch):
    engine.cache_clear()
    monkeypatch.setitem(sys.modules, "exudyn", None)
    with pytest.raises(InputError, match=r"pip install '\.\[multibody\]'"):
        engine()
    engine.cache_clear()


@pytest.mark.parametrize("name", sorted(_EFFECTS))
def test_an_effect_is_taken_under_the_librarys_names(name: str):
    parameters = {parameter.named("hoist") for parameter in find(name, "hoist").parameters}
    assert set(_EFFECTS[name]) == parameters
    values = dict.fromkeys(parameters, 0.125)
    changed = switches_of(MACHINE.model_copy(update={"effects": {name: values}}))
    fields = {field for parameter in parameters for field in _EFFECTS[name][parameter]}
    assert all(getattr(changed, field) == 0.125 for field in fields)


@pytest.mark.parametrize(
    ("update", "said"),
    [
        ({"effects": {"friction_viscos": {}}}, "did you mean 'friction_viscous'"),
        ({"effects": {"backlash": {"play_rad": 0.01}}}, "has no effect 'backlash'"),
        ({"effects": {"heave": {"amplitude": 0.1}}}, "did you mean 'amplitude_m'"),
        ({"measured_correction": object()}, "no measured correction"),
    ],
)
def test_what_it_does_not_know_is_one_clear_error(update: dict[str, object], said: str):
    with pytest.raises(InputError, match=said):
        switches_of(MACHINE.model_copy(update=update))
