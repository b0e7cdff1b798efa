"""Imports go one way: physics knows no files, studies know no screens, the help loads nothing heavy."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "workbench"

# Each row may import the rows above it. Neighbours in one row do not know each other.
LAYERS = [
    ("core",),
    ("symbolic",),
    ("trace",),
    ("machines",),
    ("engine",),
    ("logs", "control", "references", "metrics"),
    ("effects",),
    ("simulate",),
    ("identify", "analysis"),
    ("study",),
    ("export", "testing", "serve"),
    ("diagnose",),
    ("blind", "watch"),
    ("view",),
    ("api", "dashboard"),
    ("cli",),
    ("__main__",),
]
LEVEL = {name: level for level, row in enumerate(LAYERS) for name in row}

# The physics' floor stays quick to import and knows no screens.
FLOOR = ("core", "symbolic", "machines", "engine")
TOO_HEAVY_FOR_THE_FLOOR = {"scipy", "control", "streamlit", "plotly", "pandas", "matplotlib"}
TOO_HEAVY_FOR_HELP = ["numpy", "numba", "scipy", "pydantic", "plotly", "pyarrow", "control", "pandas", "streamlit"]

MODULES = sorted(PACKAGE.rglob("*.py"))


def layer_of(module: Path) -> str | None:
    """The layer's name, None for the package's own __init__, which holds the version only."""
    first = module.relative_to(PACKAGE).parts[0].removesuffix(".py")
    return None if first == "__init__" else first


def imported(node: ast.AST, package: tuple[str, ...]) -> list[str]:
    """Absolute dotted names that an import statement may load; [] for any other node."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        base = package[: len(package) - node.level + 1] if node.level else ()
        stem = ".".join([*base, *([node.module] if node.module else [])])
        return [f"{stem}.{alias.name}" for alias in node.names]
    return []


def wrong_imports(source: str, layer: str | None, package: tuple[str, ...]) -> list[str]:
    """What a module of `layer` imports from its own row's neighbours or from below."""
    wrong = []
    for node in ast.walk(ast.parse(source)):
        for name in imported(node, package):
            parts = name.split(".")
            if parts[0] != "workbench" or parts[1:2] == ["__version__"] or parts[1:2] == [layer]:
                continue
            target = parts[1] if len(parts) > 1 else "workbench"
            if target not in LEVEL or LEVEL[target] >= LEVEL.get(layer or "", -1):
                wrong.append(f"line {node.lineno}: {name}")  # type: ignore[attr-defined]
    return wrong


def at_import_time(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes that run when the module is imported: no function bodies, nothing for type checkers only."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        yield node
        yield from at_import_time(node)


def heavy_imports(source: str, package: tuple[str, ...]) -> list[str]:
    names = [name for node in at_import_time(ast.parse(source)) for name in imported(node, package)]
    return [name for name in names if name.split(".")[0] in TOO_HEAVY_FOR_THE_FLOOR]


def package_of(module: Path) -> tuple[str, ...]:
    return module.relative_to(ROOT).parent.parts


def test_every_module_has_a_place_in_the_layer_table():
    homeless = {str(m.relative_to(ROOT)) for m in MODULES if layer_of(m) not in {None, *LEVEL}}
    assert not homeless, f"add these to LAYERS: {sorted(homeless)}"


@pytest.mark.parametrize("module", MODULES, ids=lambda m: str(m.relative_to(PACKAGE)))
def test_a_module_imports_only_from_the_layers_above_its_own(module: Path):
    assert wrong_imports(module.read_text(encoding="utf-8"), layer_of(module), package_of(module)) == []


@pytest.mark.parametrize(
    "module", [m for m in MODULES if layer_of(m) in FLOOR], ids=lambda m: str(m.relative_to(PACKAGE))
)
def test_the_physics_floor_imports_nothing_heavy_at_module_level(module: Path):
    assert heavy_imports(module.read_text(encoding="utf-8"), package_of(module)) == []


def test_the_rooms_of_the_diagnosis_import_each_other_one_way():
    """A room is a folder of workbench/diagnose or a module beside them; imports for type checkers count too."""
    rooms: dict[str, set[str]] = {}
    for module in (PACKAGE / "diagnose").rglob("*.py"):
        room = module.relative_to(PACKAGE / "diagnose").parts[0].removesuffix(".py")
        names = [name for node in ast.walk(ast.parse(module.read_text())) for name in imported(node, ())]
        rooms.setdefault(room, set()).update(
            name.split(".")[2] for name in names if name.startswith("workbench.diagnose.")
        )
    others = {room: used - {room} for room, used in rooms.items()}
    assert set(TopologicalSorter(others).static_order()) >= {"verdict", "location", "hypotheses"}  # CycleError if not


@pytest.mark.parametrize(
    "statement",
    [
        "import workbench.cli",
        "from workbench import study",
        "from ..simulate import replay",
        "from .. import logs",
        "def late():\n    from workbench.logs import read",
        "import workbench.unheard_of",
    ],
)
def test_an_import_of_a_lower_layer_is_seen(statement: str):
    assert wrong_imports(statement, "engine", ("workbench", "engine")) != []


def test_a_heavy_import_is_seen_at_module_level_and_allowed_where_it_is_used():
    assert heavy_imports("try:\n    import scipy.signal\nexcept ImportError:\n    pass", ()) == ["scipy.signal"]
    assert heavy_imports("class A:\n    from control import tf", ()) == ["control.tf"]
    assert heavy_imports("def f():\n    import scipy", ()) == []
    assert heavy_imports("from workbench.control import pi", ()) == []
    assert heavy_imports("if TYPE_CHECKING:\n    import scipy", ()) == []


@pytest.mark.parametrize("argument", ["--help", "--version", "study-misspelt"])
def test_help_version_and_usage_errors_load_nothing_heavy(argument: str):
    code = (
        "import sys, workbench.cli\n"
        "try:\n    workbench.cli.main([sys.argv[1]])\nexcept SystemExit:\n    pass\n"
        f"print([m for m in {TOO_HEAVY_FOR_HELP} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code, argument], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


OPTION = re.compile(r"(?:^|[\s'\"`(])--[a-z]")
NAMES_OPTIONS = {"cli"}


def option_names(source: str) -> list[str]:
    """The strings of a module, docstrings apart, that name an option of the command line."""
    tree = ast.parse(source)
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    return [
        f"line {node.lineno}: {node.value}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and id(node) not in docstrings
        if isinstance(node.value, str) and OPTION.search(node.value)
    ]


def test_only_the_command_line_names_its_options():
    """A library's error names its parameter; the command line turns that into the option."""
    by_module = {}
    for module in MODULES:
        name = module.relative_to(PACKAGE).as_posix()
        if not any(name == place or name.startswith(f"{place}/") for place in NAMES_OPTIONS):
            by_module[name] = option_names(module.read_text(encoding="utf-8"))
    assert {name: lines for name, lines in by_module.items() if lines} == {}
    assert option_names("raise InputError('no', place='--free')") == ["line 1: --free"]
    assert option_names('def f():\n    """See --free."""\n    return 1 - -1') == []
