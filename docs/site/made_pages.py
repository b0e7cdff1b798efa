"""The tables of the docs that are made from declarations, by every build: effects, metrics, references, bounds.

A page of docs/ includes what `write` puts into docs/made/; none of it is edited or kept by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel

from workbench.core.yaml_strict import bounds_of
from workbench.effects import Effect, library_effects
from workbench.effects.declare import words
from workbench.effects.registry import library_for
from workbench.machines import KINDS, RECORDS
from workbench.metrics import LoopMetric, Metric, metrics, run_metrics, set_of
from workbench.references import planned_kinds, recorded_kinds
from workbench.study.scenario import Scenario


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [columns, ["---"] * len(columns), *rows]
    cells = [" | ".join(cell.replace("|", r"\|") for cell in line) for line in lines]
    return "\n".join([f"## {title}", "", *(f"| {line} |" for line in cells), ""])


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
        *table("", columns, rows).splitlines()[2:], "",
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
    titles = {"Planned from moves and limits": planned_kinds(), "Recorded": recorded_kinds()}
    return "\n".join(
        table(
            title,
            ["reference", "in figures", "what it is"],
            [[f"`{kind.name}`", kind.label, kind.definition] for kind in kinds.values()],
        )
        for title, kinds in titles.items()
    )


def bounds_page() -> str:
    """The bounds of each machine.yaml's and of a scenario's numbers."""
    parts = []
    for record in (*RECORDS, Scenario):
        fields = record.model_fields
        of = [str(fields[name].default) for name in ("kind", "motion") if name in fields]
        rows = [[f"`{name}`", f"{low:g}", f"{high:g}", reason] for name, low, high, reason in bounded(record)]
        title = f"machine.yaml, {' '.join(of)}" if of else "A scenario"
        parts.append(table(title, ["value", "from", "to", "reason"], rows))
    return "\n".join(parts)


def bounded(record: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, float, float, str]]:
    """(dotted name, lowest, highest, reason) of every number of a record whose bounds have a reason."""
    for name, field in record.model_fields.items():
        if (bounds := bounds_of(field)) is not None:
            yield f"{prefix}{name}", bounds.lowest, bounds.highest, bounds.because.reason
            continue
        inner = [line for part in _records_in(field.annotation) for line in bounded(part, f"{prefix}{name}.")]
        yield from {line[0]: line for line in inner}.values()


def _records_in(annotation: Any) -> list[type[BaseModel]]:
    """The records that an annotation holds, however deep."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [record for part in get_args(annotation) for record in _records_in(part)]


PAGES: Mapping[str, Callable[[], str]] = {
    "effects": effects_page,
    "metrics": metrics_page,
    "references": references_page,
    "bounds": bounds_page,
}


def write(folder: Path) -> None:
    """docs/made/NAME.md of every page."""
    folder.mkdir(exist_ok=True)
    for name, page in PAGES.items():
        (folder / f"{name}.md").write_text(page(), encoding="utf-8")
