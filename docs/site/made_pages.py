"""The reference pages of the docs, made from declarations by every build: effects, metrics, references, keys, commands.

A page of docs/ includes what `write` puts into docs/made/; none of it is edited or kept by hand.
"""

from __future__ import annotations

import importlib
import inspect
import re
import textwrap
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

import click
from pydantic import BaseModel
from pydantic.fields import FieldInfo

import workbench.machines
from workbench.cli import COMMANDS
from workbench.core.record import Record
from workbench.core.yaml_strict import bounds_of, load
from workbench.effects import Effect, library_effects
from workbench.effects.declare import words
from workbench.effects.registry import library_for
from workbench.logs.campaign import RunsFile
from workbench.logs.formats import opening
from workbench.logs.formats.declared import MB, Limits
from workbench.machines import KINDS, RECORDS, default_hoist, kind_of, load_machine
from workbench.metrics import LoopMetric, Metric, metrics, run_metrics, set_of
from workbench.references import planned_kinds, recorded_kinds
from workbench.study.decide import criteria_for
from workbench.study.scenario import Scenario
from workbench.study.size import SizeFile

EMPS = Path(workbench.machines.__file__).parent / "emps_axis.yaml"


def grid(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """The lines of a table."""
    cells = [" | ".join(cell.replace("|", r"\|") for cell in line) for line in (columns, ["---"] * len(columns), *rows)]
    return [*(f"| {line} |" for line in cells), ""]


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join([f"## {title}", "", *grid(columns, rows)])


def effects_page(effects: Sequence[Effect] | None = None) -> str:
    """A section for each effect: equation, where it acts, its parameters."""
    shown = sorted(library_effects() if effects is None else effects, key=lambda effect: (not effect.listed, effect.id))
    twice = {effect.id for effect in shown if sum(other.id == effect.id for other in shown) > 1}
    titles = {
        effect: f"{effect.id}-{effect.kinds[0].partition('-')[0]}" if effect.id in twice else effect.id
        for effect in shown
    }
    index = [f"- [{title}](#{title}): {effect.meaning}" for effect, title in titles.items()]
    return "\n".join([*index, "", *(line for effect, title in titles.items() for line in _section(effect, title))])


def _section(effect: Effect, title: str) -> list[str]:
    kinds = [kind for kind in effect.kinds if effect not in library_effects() or effect in library_for(kind)]
    where = [(kind, effect.place_on(kind), effect.subsystem(kind)) for kind in kinds]
    places = "; ".join(dict.fromkeys(f"{kind.partition('-')[0]}: {place} ({of})" for kind, place, of in where))
    traits = {
        "takes energy only": effect.dissipative,
        "keeps a state": bool(effect.memory),
        "not listed": not effect.listed,
    }
    reads = "; ".join(f"{name}: {meaning.format(**words('hoist'))}" for name, meaning in effect.reads.items())
    rows = [
        [
            ", ".join(dict.fromkeys(f"`{p.named(kind)}`" for kind in kinds)),
            p.meaning + (", each run's own" if p.per_run else ""),
            p.size,
            f"{p.lowest:.4g} … {p.highest:.4g}",
            f"{p.scale:g}",
            f"{p.start:g}",
            "–" if p.vanishes_at is None else f"{p.vanishes_at:g}",
        ]
        for p in effect.parameters
    ]
    columns = ["parameter", "", "unit of the numbers", "bounds", "scale", "start", "vanishes at"]
    return [
        f"### {title}", "", effect.meaning, "", f"    {effect.equation}", "",
        "; ".join([f"- acts at {places}", f"regime: {effect.regime}", *(name for name, has in traits.items() if has)]),
        *([f"- reads {reads}"] if reads else []),
        f"- shows as {effect.shows}",
        f"- source: {effect.reference}", "",
        *grid(columns, rows),
    ]  # fmt: skip


_BETTER = {"lower": "lower", "higher": "higher", "zero": "nearer to 0", None: "–"}


def metrics_page() -> str:
    """The metrics of the hoist, then those of each other set that a kind of machine has."""

    def of(title: str, declared: Sequence[Metric]) -> str:
        rows = [[f"`{m.name}`", m.unit, _BETTER[m.better], f"{m.visible:g}", m.definition] for m in declared]
        return table(title, ["metric", "unit", "better", "least", "what it is"], rows)

    known = metrics()
    parts = [
        of("From the loop", [metric for metric in known if isinstance(metric, LoopMetric)]),
        of("From the run's reference and its machine", run_metrics()),
    ]
    sets = {id(set_of(kind)): kind for kind in reversed(KINDS) if KINDS[kind].looped.position_loop}
    for kind in reversed(sets.values()):
        sharing = [name for name in KINDS if set_of(name) is set_of(kind)]
        parts.append(of(f"Of {', '.join(sharing)}", set_of(kind).metrics))
    return "\n".join(parts)


def references_page() -> str:
    """What is planned from moves and limits, then what is recorded."""
    titles: dict[str, Mapping[str, Any]] = {
        "Planned from moves and limits": planned_kinds(),
        "Recorded": recorded_kinds(),
    }
    return "\n".join(
        table(
            title,
            ["reference", "in figures", "what it is"],
            [[f"`{kind.name}`", kind.label, kind.definition] for kind in kinds.values()],
        )
        for title, kinds in titles.items()
    )


def keys_page() -> str:
    """The keys of each file that a user writes: default, allowed values, meaning; then why the bounds are there."""
    parts: list[str] = []
    reasons: dict[tuple[str, str], None] = {}
    seen: dict[type, str] = {}
    for title, record in FILES.items():
        parts += [f"## {title}", "", *_block("", record, title, seen, reasons)]
    rows = [[*limits.split(" … "), reason] for (limits, reason) in reasons]
    return "\n".join([*parts, table("Why the bounds are there", ["from", "to", "reason"], rows)])


def titled(record: type[BaseModel]) -> str:
    words = [str(record.model_fields[name].default) for name in ("kind", "motion") if name in record.model_fields]
    return f"machine.yaml, {' '.join(words)}"


FILES: Mapping[str, type[BaseModel]] = {titled(record): record for record in RECORDS} | {
    "A scenario": Scenario, "runs.yaml": RunsFile, "A file of `workbench size`": SizeFile,
}  # fmt: skip


def _block(
    place: str, record: type[BaseModel], title: str, seen: dict[type, str], reasons: dict[tuple[str, str], None]
) -> list[str]:
    """A block's text and table, then the blocks in it; one that stood before is named only."""
    if record in seen:
        return [f"**{place}**: the same keys as in {seen[record]}.", ""]
    seen[record] = f"`{place}`, {title}"
    fields = {field.alias or name: field for name, field in record.model_fields.items()}
    text, meanings = explained(record, fields)
    rows, inner = [], []
    for key, field in fields.items():
        dotted = f"{place}.{key}".strip(".")
        for block in _records_in(field.annotation):
            inner += _block(dotted, block, title, seen, reasons)
        if (bounds := bounds_of(field)) is not None:
            reasons[f"{bounds.lowest:g} … {bounds.highest:g}", bounds.because.reason] = None
        if key in meanings or not _records_in(field.annotation):  # another block follows with its own text
            rows.append([f"`{dotted}`", _default(field), _allowed(field), meanings.get(key, "")])
    columns = ["key", "default", "values", "meaning"][: 4 if any(row[3] for row in rows) else 3]
    head = [f"**{place}**: {text}" if place else text, ""]
    return [*head, *grid(columns, [row[: len(columns)] for row in rows]), *inner]


def explained(record: type[BaseModel], keys: Collection[str]) -> tuple[str, dict[str, str]]:
    """A record's docstring: its own text, and what it says of each key as `key, key: meaning`."""
    one = f"(?:{'|'.join(sorted(map(re.escape, keys), key=len, reverse=True))})"
    text, meanings = "", dict[str, str]()
    for base in reversed([base for base in record.__mro__ if issubclass(base, Record) and base is not Record]):
        said = " ".join(inspect.cleandoc(vars(base).get("__doc__") or "").split())
        own, *parts = re.split(rf"(?:(?<=^)|(?<=[.;,] ))({one}(?:, {one})*): ", said)
        text = " ".join(
            sentence for sentence in re.split(r"(?<=\.) ", own.strip()) if not sentence.startswith("Raises")
        )
        for names, meaning in zip(parts[::2], parts[1::2], strict=True):
            meanings |= dict.fromkeys(names.split(", "), meaning.strip().rstrip(".;"))
    return text, meanings


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    value = field.default
    if isinstance(value, BaseModel) or value in (None, "", ()) or field.default_factory is not None:
        return "–"
    if isinstance(value, bool):
        return f"`{value}`".lower()
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def _allowed(field: FieldInfo) -> str:
    """Bounds of a number, words of a choice."""
    if (bounds := bounds_of(field)) is not None:
        return f"{bounds.lowest:g} … {bounds.highest:g}"
    if field.annotation is bool:
        return "true, false"
    if _records_in(field.annotation):
        return "block"
    words = [word for part in (field.annotation, *get_args(field.annotation)) for word in get_args(part)]
    if words and all(isinstance(word, str) for word in words):
        return ", ".join(f"`{word}`" for word in words)
    signs = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
    found = [f"{sign} {getattr(part, name):g}" for part in field.metadata for name, sign in signs.items()
             if isinstance(getattr(part, name, None), int | float)]  # fmt: skip
    return ", ".join(found)


def _records_in(annotation: Any) -> list[type[BaseModel]]:
    """The records that an annotation holds, however deep."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [record for part in get_args(annotation) for record in _records_in(part)]


def signals_page() -> str:
    """What a log of each kind holds."""

    def needed(group: Sequence[Sequence[str]]) -> str:
        return " or ".join(" and ".join(f"`{name}`" for name in alternative) for alternative in group)

    rows = [
        [
            name,
            ", ".join(needed(group) for group in kind.signals.needed),
            ", ".join(f"`{s}`" for s in kind.signals.optional),
        ]
        for name, kind in KINDS.items()
    ]
    return "\n".join(grid(["machine", "required", "optional"], rows))


def log_formats_page() -> str:
    """The formats with their endings and properties, and the limits."""
    lines = []
    for one in opening.FORMATS:
        text = f"- **{one.name}** ({', '.join(f'`{suffix}`' for suffix in one.suffixes)}): {one.about}"
        lines.append(textwrap.fill(text, 116, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False))
    lines += ["", "Limits of one log, counted in what is produced from it:", ""]
    lines += ["| format | whose | rows | unpacked | processor time | memory of the reader | read in |"]
    lines += ["|---|---|---|---|---|---|---|"]
    for one in opening.FORMATS:
        own = "a worker" if one.isolated else "this process"
        lines.append(f"| {one.name} | your own | {_cells(one.own)} | {own} |")
        lines.append(f"| {one.name} | uploaded | {_cells(one.uploaded)} | a worker |")
    return "\n".join(lines) + "\n"


def _cells(limits: Limits) -> str:
    memory = limits.memory_bytes / MB
    return f"{limits.rows / MB:g} million | {limits.bytes / MB:g} MB | {limits.seconds:g} s | {memory:g} MB"


def gallery_page() -> str:
    """The scenarios that ship, each with its own description."""
    files = sorted((Path(__file__).resolve().parents[2] / "scenarios").glob("*.yaml"))
    rows = [[f"`{file.name}`", str(load(file).data.get("description", ""))] for file in files]  # type: ignore[attr-defined]
    return "\n".join(grid(["file", "what it shows"], rows))


def criteria_page() -> str:
    """The usual criteria of the decision: of the default hoist at 9000 kg and of the EMPS axis."""
    machines = {"hoist, 9000 kg": (default_hoist(), 9000.0), "axis": (load_machine(EMPS), 0.0)}
    rows = [
        [title, f"`{c.name}`", c.limit_words, c.text(c.scale) if c.scale else "–", f"{c.weight:g}"]
        for title, (machine, payload_kg) in machines.items()
        for c in criteria_for(set_of(kind_of(machine).name), machine, payload_kg)
    ]
    return "\n".join(grid(["machine", "criterion", "limit", "scale", "weight"], rows))


def commands_page() -> str:
    """Every command with its options, as `--help` has them."""
    parts = []
    for name, (where, line) in COMMANDS.items():
        module, attribute = where.split(":")
        command = getattr(importlib.import_module(module), attribute)
        parts += _command(f"workbench {name}", command, line)
    return "\n".join(parts)


def _command(title: str, command: click.Command, line: str) -> list[str]:
    context = click.Context(command)
    if isinstance(command, click.Group):
        parts = [command.get_command(context, name) for name in command.list_commands(context)]
        return [row for part in parts if part for row in _command(f"{title} {part.name}", part, part.help or "")]
    usage = " ".join([title, *command.collect_usage_pieces(context)])
    options = [p for p in command.params if isinstance(p, click.Option) and not p.hidden]
    rows = [[f"`{record[0]}`", record[1]] for p in options if (record := p.get_help_record(context))]
    text = inspect.cleandoc(command.help or line).replace("\b", "")
    return [f"## {title}", "", f"    {usage}", "", *text.split("\n"), "", *grid(["option", ""], rows)]


PAGES: Mapping[str, Callable[[], str]] = {
    "effects": effects_page,
    "metrics": metrics_page,
    "references": references_page,
    "bounds": keys_page,
    "signals": signals_page,
    "log_formats": log_formats_page,
    "gallery": gallery_page,
    "criteria": criteria_page,
    "commands": commands_page,
}


def write(folder: Path) -> None:
    """docs/made/NAME.md of every page."""
    folder.mkdir(exist_ok=True)
    for name, page in PAGES.items():
        (folder / f"{name}.md").write_text(page(), encoding="utf-8")
