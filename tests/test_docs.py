"""What the pages say of the program is so: links, commands, code, names. `make docs` itself needs no part of this."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import json
import math
import re
import shlex
from pathlib import Path
from types import ModuleType

import click
import pytest

from tests.support.commands import Commands
from tests.support.made_pages import made_pages
from workbench.cli import COMMANDS
from workbench.diagnose.diagnose import diagnose
from workbench.effects import library_effects
from workbench.logs import Campaign
from workbench.machines import KINDS, RECORDS
from workbench.metrics import columns, metrics
from workbench.references import planned_kinds, recorded_kinds

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.glob("*.md"))]
FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"(?:^|(?<=\n\n))((?: {4}.*\n|\n(?= {4}))+)")
LINK = re.compile(r"!?\[[^\]]*\]\(([^()\s]+)\)")
TEMPLATES = {"COMMAND"}  # stands for any command

each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


def prose(text: str) -> str:
    """The page without its blocks of code."""
    return FENCE.sub("", text)


def anchors(text: str) -> set[str]:
    """Of the headings, as a Git host and the site make them: lower case, hyphens for blanks, other signs dropped."""
    counts: dict[str, int] = {}
    made = set()
    for heading in re.findall(r"^#{1,6} +(.+?) *$", prose(text), re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        slug = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
        made.add(f"{slug}-{counts[slug]}" if slug in counts else slug)
        counts[slug] = counts.get(slug, 0) + 1
    return made


def command_lines(text: str) -> list[str]:
    """Every `workbench …` that a reader may type: lines of code blocks, and code within the text."""
    blocks = [body for _, body in FENCE.findall(text)] + INDENTED.findall(prose(text))
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    lines += re.findall(r"`([^`\n]+)`", prose(text))
    return [line for line in lines if re.match(r"workbench [\w-]", line)]


def command_of(name: str) -> click.Command:
    module, attribute = COMMANDS[name][0].split(":")
    command = getattr(importlib.import_module(module), attribute)
    assert isinstance(command, click.Command)
    return command


def parts_of(command: click.Command) -> list[click.Command]:
    """The command, and those of a group."""
    if not isinstance(command, click.Group):
        return [command]
    context = click.Context(command)
    parts = [command.get_command(context, name) for name in command.list_commands(context)]
    return [command, *(part for part in parts if part is not None)]


def fault_of(line: str) -> str:
    """What is wrong with a command line, "" if nothing is."""
    words = shlex.split(re.split(r"\s[|>]|\s#", line)[0].replace("…", ""))[1:]
    if words[0].startswith("-"):
        return "" if words[0] in ("--help", "--version") else f"no option {words[0]}"
    if words[0] in TEMPLATES:
        return ""
    if words[0] not in COMMANDS:
        return f"no command {words[0]}"
    command = command_of(words[0])
    if isinstance(command, click.Group) and len(words) > 1:
        part = command.get_command(click.Context(command), words[1])
        if part is None:
            return f"no command {words[0]} {words[1]}"
        words, command = words[1:], part
    context = click.Context(command, help_option_names=["-h", "--help"])
    try:
        given, _, _ = command.make_parser(context).parse_args(words[1:])
        for param in command.params:
            if param.name in given and isinstance(param.type, click.Choice):
                param.type_cast_value(context, given[param.name])
    except click.UsageError as error:
        return error.format_message()
    return ""


def test_every_page_is_in_the_table_of_contents_once():
    toc = re.search(r"^```\{toctree\}\n(.*?)^```$", (DOCS / "index.md").read_text(encoding="utf-8"), re.M | re.S)
    assert toc
    entries = [line for line in toc[1].splitlines() if line and not line.startswith(":")]
    named = [re.sub(r".*<(.+)>$", r"\1", entry) for entry in entries]
    assert sorted(named) == sorted(page.stem for page in DOCS.glob("*.md") if page.stem != "index")


@each_page
def test_every_link_leads_somewhere(page: Path):
    text = page.read_text(encoding="utf-8")
    broken = []
    for target in LINK.findall(prose(text)):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        if not file.exists() or (anchor and anchor not in anchors(file.read_text(encoding="utf-8"))):
            broken.append(target)
    assert broken == []


def test_every_folder_that_contributing_names_is_there():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w.]+(?:/[\w.]+)*/|(?:[\w]+/)*\w+\.py)`", text)) - {"workbench/cli/NAME.py"}
    assert len(named) > 30
    roots = (ROOT, ROOT / "workbench")
    assert [path for path in sorted(named) if not any((root / path).exists() for root in roots)] == []


@each_page
def test_no_line_of_text_vanishes_as_a_comment(page: Path):
    """To the site's generator a line that begins with % is one, and +++ a break."""
    assert re.findall(r"^ *(?:%|\+\+\+).*", prose(page.read_text(encoding="utf-8")), re.MULTILINE) == []


@each_page
def test_every_command_line_is_one_that_workbench_takes(page: Path):
    lines = command_lines(page.read_text(encoding="utf-8"))
    assert [f"{line}: {fault}" for line in lines if (fault := fault_of(line))] == []


@each_page
def test_every_option_named_in_the_text_is_one_of_some_command(page: Path):
    options = {word for name in COMMANDS for part in parts_of(command_of(name)) for p in part.params for word in p.opts}
    named = set(re.findall(r"`(--[\w-]+)", prose(page.read_text(encoding="utf-8"))))
    assert named - options - {"--help", "--version"} == set()


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_without_what_it_needs_says_what_is_missing(name: str, commands: Commands):
    command = command_of(name)
    for part in parts_of(command):
        if any(parameter.required for parameter in part.params):
            ended = commands(name, *([part.name] if isinstance(command, click.Group) else []))
            assert ended.status == 2 and "Error: Missing " in ended.err


def test_a_command_line_is_found_and_what_is_wrong_with_it_is_seen():
    text = "a\n\n    workbench study x\n\n`workbench app` b\n\n```sh\nworkbench replay C\n```\n\nworkbench is no line\n"
    assert sorted(command_lines(text)) == ["workbench app", "workbench replay C", "workbench study x"]
    assert sum(len(command_lines(page.read_text(encoding="utf-8"))) for page in PAGES) > 30
    for line in (
        "study FILE… --out DIR",
        "COMMAND --help",
        "identify C --list    # x",
        "schema machine > m.json",
        "blind run DIR",
    ):
        assert fault_of(f"workbench {line}") == "", line
    faults = {
        "identfy C": "no command identfy", "identify C --fre x": "--free", "loop --motion sideways": "is not one of",
        "blind rum DIR": "no command blind rum", "blind run DIR --cases 3": "--cases",
    }  # fmt: skip
    assert [line for line, fault in faults.items() if fault not in fault_of(f"workbench {line}")] == []


@each_page
def test_every_other_command_names_a_make_target_or_a_module(page: Path):
    text = page.read_text(encoding="utf-8")
    code = "\n".join([*(body for _, body in FENCE.findall(text)), *INDENTED.findall(prose(text))])
    code += "\n" + "\n".join(re.findall(r"`([^`\n]+)`", prose(text)))
    targets = set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    assert set(re.findall(r"^ *(?:\w+=\w+ )*make (\w+)", code, re.MULTILINE)) - targets == set()
    modules = set(re.findall(r"python -m ((?:workbench|benchmarks)[\w.]*)", code))
    assert [name for name in modules if importlib.util.find_spec(name) is None] == []


@each_page
def test_every_python_block_compiles_and_imports_what_there_is(page: Path):
    for language, body in FENCE.findall(page.read_text(encoding="utf-8")):
        if language != "python":
            continue
        for node in ast.walk(ast.parse(body, page.name)):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("workbench"):
                module = importlib.import_module(node.module)
                assert [alias.name for alias in node.names if not hasattr(module, alias.name)] == [], node.module


@pytest.fixture
def one_diagnosis(monkeypatch: pytest.MonkeyPatch) -> None:
    """A diagnosis of the demo campaign takes half a minute: the first one serves all pages, and looks for no pairs."""
    import workbench.diagnose.diagnose as task

    def kept(campaign: Campaign, **options: object) -> object:
        key = (campaign.name, *sorted(options.items()))
        if key not in DIAGNOSES:
            DIAGNOSES[key] = diagnose(campaign, **{**options, "most_effects": 1})  # type: ignore[arg-type]
        return DIAGNOSES[key]

    monkeypatch.setattr(task, "diagnose", kept)


DIAGNOSES: dict[tuple[object, ...], object] = {}


@pytest.mark.usefixtures("one_diagnosis")
def test_the_examples_of_the_api_page_and_the_cells_of_the_notebook_run(tmp_path, monkeypatch, capsys):
    """One test, so that one process makes the diagnosis that both show."""
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    monkeypatch.chdir(tmp_path)
    run_api_page()
    assert (tmp_path / "identified.yaml").is_file()
    said = capsys.readouterr().out
    assert "9000kg_ruckig_equal_time" in said and "OperatingPoint(payload_kg=" in said
    assert "friction_load_dependent" in said
    run_notebook()


def run_api_page() -> None:
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    examples = [body for language, body in FENCE.findall(text) if language == "python"]
    assert len(examples) == 8
    assert max(len(body.splitlines()) for body in examples) <= 12
    names: dict[str, object] = {}
    for body in examples:
        exec(compile(body, "api.md", "exec"), names)


def run_notebook() -> None:
    """Every cell, and its outputs are the kept ones."""
    notebook = DOCS / "log_to_decision.ipynb"
    names: dict[str, object] = {}
    site = of_the_site("notebook")
    shown = [site.run_cell(source, names, number) for number, source in enumerate(site.cells_of(notebook), 1)]
    cells = [cell for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    for cell, (printed, value) in zip(cells, shown, strict=True):
        assert bool(cell["outputs"]) == bool(printed or value is not None), cell["source"]
    kept = json.dumps([cell["outputs"] for cell in cells], ensure_ascii=False)
    assert names["diagnosis"].verdict.effects[0] in kept  # type: ignore[attr-defined]
    assert kept.count('"image/png"') >= 3
    decision = next(text for text in site.cells_of(notebook, "markdown") if text.startswith("## The decision"))
    said = " ".join(f"{printed} {value!r}" for printed, value in shown)
    assert [number for number in re.findall(r"\b\d{3,}\b", decision) if number not in said] == []
    assert notebook.stat().st_size < 1_000_000


def test_every_name_of_the_api_page_exists_and_says_what_it_is():
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    names = re.findall(r"^\.\. auto(?:class|function|exception):: ([\w.]+)", text, re.MULTILINE)
    assert len(names) > 60
    for name in names:
        module, _, attribute = name.rpartition(".")
        thing = getattr(importlib.import_module(module), attribute)
        assert (getattr(thing, "__doc__", "") or "").strip(), name


def test_the_first_result_of_the_start_page_is_what_the_study_prints(tmp_path, capsys):
    page = (DOCS / "start.md").read_text(encoding="utf-8").partition("## The first result")[2].partition("## ")[0]
    shown = [line for line in page.splitlines() if line.startswith("    ") and "payload" not in line]
    assert len(shown) > 5
    study = Commands(capsys)("study", ROOT / "scenarios" / "payloads.yaml", "--out", tmp_path / "out")
    said = " ".join(study.out.split())
    for line in (*shown[1:4], " ".join(shown[4:])):
        assert " ".join(line.split()) in said


def test_the_figures_of_the_model_page_follow_from_its_equations():
    """Hanging still, the modes of the carriage, inertia and friction at the motor, from the values of machine.yaml."""
    from workbench.machines import default_hoist

    m, g, tau = default_hoist(), 9.81, default_hoist().wire.damping_time_s
    i, R, r, L = 1.0 / m.gearbox.ratio, m.winch.drum_diameter_m / 2, m.sheave.diameter_m / 2, m.wire.segment_length_m
    k, rho = m.wire.youngs_modulus_pa * m.wire.effective_area_m2 / L, 7850.0 * m.wire.effective_area_m2
    drive, lift, turn = m.turning_inertia_kg_m2, i * R / 2, i * R / (2 * r)
    rows: dict[str, list[str]] = {"inertia": [], "free": [], "held": [], "friction": [], "stretch": [], "hold": []}
    for payload in (0.0, 4500.0, 9000.0):
        mass = m.carriage.mass_kg + payload
        free, held = math.sqrt(2 * k * (1 / mass + (i * R) ** 2 / (4 * drive))), math.sqrt(2 * k / mass)
        rows["inertia"].append(f"{drive + m.sheave.inertia_kg_m2 * turn**2 + mass * lift**2:.3f}")
        rows["free"].append(f"{free / math.tau:.2f}, {free * tau / 2:.2f}")
        rows["held"].append(f"{held / math.tau:.2f}, {held * tau / 2:.2f}")
        stretch = (mass * g + rho * g * (L - 10.0)) / (2 * k + rho * g)
        rows["stretch"].append(f"{1000 * stretch:.1f}")
        rows["hold"].append(f"{i * R * (k * stretch + rho * g * (L - 10.0) / 2):.1f}")
        mu = m.bearing.pin_friction_coefficient
        guide = m.guide.coulomb_hoisting_n * 2 / math.pi * math.atan(0.5 * m.guide.atan_slope_s_per_m)
        pull = k * stretch + guide / 2
        winch = mu * (m.winch.mass_kg * g + pull + rho * g * (L - 10.0) / 2) * m.winch.pin_diameter_m / 2 * i
        sheave = mu * (2 * pull - rho * g * (L - 10.0) - m.sheave.mass_kg * g) * m.sheave.pin_diameter_m / 2 * turn
        rows["friction"].append(f"{guide * lift:.1f}, {winch:.1f}, {sheave:.1f}")
    page = (DOCS / "model.md").read_text(encoding="utf-8")
    for name in ("inertia", "free", "held", "friction"):
        assert f" | {' | '.join(rows[name])} |\n" in page, (name, rows[name])
    for name in ("stretch", "hold"):
        assert f"= {', '.join(rows[name])} " in page, (name, rows[name])


def of_the_site(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, DOCS / "site" / f"{name}.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_page_that_would_fetch_from_elsewhere_is_seen_and_a_link_to_follow_is_none():
    loaded = of_the_site("offline").loaded
    fetched = {
        '<script async src="https://cdn.example/x.js">': "https://cdn.example/x.js",
        "<link rel=stylesheet href=//cdn.example/x.css>": "//cdn.example/x.css",
        "src: url('http://fonts.example/a.woff2')": "http://fonts.example/a.woff2",
        '@import "https://cdn.example/x.css";': "https://cdn.example/x.css",
    }
    assert [text for text, address in fetched.items() if loaded(text) != [address]] == []
    followed = '<a href="https://doi.org/1">', '<img src="_images/a.png">', '<link href="_static/a.css">', "url(#clip)"
    assert [text for text in followed if loaded(text)] == []


def test_files_of_effects_that_name_the_folder_trace_are_still_read():
    from workbench.symbolic import expr as now
    from workbench.trace import expr as then

    assert then.where is now.where and then.absolute is now.absolute and then.exp is now.exp


# The pages that the build of the docs makes from declarations miss nothing that is declared.


MADE = made_pages()


def test_the_build_writes_every_page_and_some_page_of_the_docs_includes_it(tmp_path: Path):
    MADE.write(tmp_path / "made")
    assert {file.stem: file.read_text(encoding="utf-8") for file in (tmp_path / "made").iterdir()} == {
        name: page() for name, page in MADE.PAGES.items()
    }
    docs = "".join(page.read_text(encoding="utf-8") for page in DOCS.glob("*.md"))
    assert [name for name in MADE.PAGES if docs.count(f"```{{include}} made/{name}.md\n```\n") != 1] == []


def test_every_effect_has_its_section_with_all_its_parameters():
    page = MADE.effects_page()
    for effect in library_effects():
        assert f"### {effect.id}" in page and effect.meaning in page and f"    {effect.equation}\n" in page
        assert all(f"`{p.named(kind)}`" in page for p in effect.parameters for kind in effect.kinds)


def test_every_column_of_an_index_is_defined_with_its_unit():
    assert set(columns()) <= {metric.name for metric in metrics()}
    assert all(f"| `{metric.name}` | {metric.unit} | " in MADE.metrics_page() for metric in metrics())


def test_every_reference_and_every_signal_of_a_log_has_its_place():
    assert all(f"| `{name}` | " in MADE.references_page() for name in {**planned_kinds(), **recorded_kinds()})
    rows = {row.split(" | ")[0].strip("| "): row for row in MADE.signals_page().splitlines()}
    for name, kind in KINDS.items():
        assert all(f"`{signal}`" in rows[name] for signal in kind.signals.names)


def keys(record: type, prefix: str = "") -> list[str]:
    """Every key of a record and of the blocks in it, dotted."""
    found = []
    for name, field in record.model_fields.items():  # type: ignore[attr-defined]
        place = f"{prefix}{field.alias or name}"
        found += [place, *(key for block in MADE._records_in(field.annotation) for key in keys(block, f"{place}."))]
    return found


@pytest.mark.parametrize("record", RECORDS[:2])
def test_every_key_of_machine_yaml_has_its_line(record: type):
    page = MADE.keys_page()
    assert len(keys(record)) > 25
    assert [key for key in keys(record) if f"| `{key}` | " not in page and f"**{key}**: " not in page] == []


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_and_option_has_its_line(name: str):
    page = MADE.commands_page()
    for part in parts_of(command_of(name))[-1:]:
        options = [p for p in part.params if isinstance(p, click.Option) and not p.hidden]
        assert [p.opts[0] for p in options if f"`{p.opts[0]}" not in page and f", {p.opts[0]}" not in page] == []
