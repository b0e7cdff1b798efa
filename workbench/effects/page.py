"""docs/effects.md, made from the declarations: `python -m workbench.effects.page > docs/effects.md`."""

from __future__ import annotations

from collections.abc import Sequence

from workbench.effects.declare import Effect
from workbench.effects.parameter import Parameter, words
from workbench.effects.registry import library_effects, library_for

HEAD = """# Effects

What a nominal machine leaves out and a real one may have. Each is declared once, beside its function in
`workbench/effects`; this page is made from the declarations (`python -m workbench.effects.page > docs/effects.md`).

In machine.yaml or in a scenario:

    effects:
      drum_eccentricity: {amplitude_m: 0.004, phase_rad: 1.2}
      friction_viscous: {viscous_n_s_per_m: 4000}

A parameter that is not given takes its start value; one that says how large the effect is vanishes, and at least one of
those has to be given. At its vanishing values an effect is off to the last bit.

Bounds (of a fit), scale and start are in units of the machine's own sizes, so that they fit a machine of any size.

| size | of a hoist | of an axis |
|---|---|---|
| force | weight of the empty carriage | largest input |
| torque | nominal, all motors together | largest input |
| speed, motor_speed | of the carriage at nominal motor speed, of the motor | largest speed |
| length | of a fall of wire | travel |
| radius, drum_angle | of the drum, and how far it turns for the whole length | travel |
| mass, inertia | of the carriage; of drive and drum at the motor | inertia |

Where a parameter has several names, they are those of the hoist, of the linear and of the rotary axis. Signals are in
N and m, on a rotary axis in N m and rad.

Effects marked *not listed* are there for simulation; a diagnosis weighs them only when asked.

## An effect of your own

A function in a Python file, named with `--effects FILE` or by an entry point of the group `workbench.effects`:

```python
from workbench.effects import Parameter, effect
from workbench.trace.expr import absolute


@effect(
    place={"hoist": "guide_force_n"},
    subsystem="guide",
    regime="speed",
    parameters=[
        Parameter(
            "c",
            "wind_n_s2_per_m2",
            "drag over speed squared",
            "force/speed*speed",
            lowest=0.0,
            highest=1.0,
            scale=0.02,
            start=0.03,
            vanishes_at=0.0,
            domain="not_negative",
        ),
    ],
    reads={"v": "carriage speed, m/s"},
    equation="F = −c v |v|",
    reference="drag in proportion to dynamic pressure",
    shows="a residual that grows with the square of the speed",
    dissipative=True,
)
def wind(s, e, p):
    \"\"\"Drag of the air on the load.\"\"\"
    return -(e.c * s.v * absolute(s.v))
```

s holds the signals at the place, e the effect's parameters, p the plant's. The function is traced, differentiated and
compiled: arithmetic and the functions of `workbench.trace.expr` only, `where` instead of `if`, exactly zero at the
vanishing values. A state of its own is an `EffectMemory`; what a sensor does is a function of the whole series
(places torque_sensor, speed_sensor) with its inverse.

The commands `study`, `replay`, `identify`, `loop`, `tune` and `diagnose` take the file; the option may be repeated:

    workbench study windy.yaml --effects my_effects.py

where windy.yaml holds `effects: {wind: {wind_n_s2_per_m2: 40}}`.

The file is Python and is run: take it from people you trust. It is read before everything else; one that fails,
declares nothing, takes a name that is taken, reads a signal that is not at its place or is not zero at its vanishing
values is refused in one line. A study that uses such an effect is another study when the file's text changes (what the
file imports is not watched), its workers on a cluster get that very text, and the result keeps a copy of the file.
"""


def page(effects: Sequence[Effect] | None = None) -> str:
    """The page for these effects, the library's by default."""
    shown = sorted(library_effects() if effects is None else effects, key=lambda effect: (not effect.listed, effect.id))
    twice = {effect.id for effect in shown if sum(other.id == effect.id for other in shown) > 1}
    titles = {
        effect: f"{effect.id}-{effect.kinds[0].partition('-')[0]}" if effect.id in twice else effect.id
        for effect in shown
    }
    index = [f"- [{title}](#{title}): {effect.meaning}" for effect, title in titles.items()]
    sections = (line for effect, title in titles.items() for line in _section(effect, title))
    return "\n".join([HEAD, "## All effects", "", *index, "", *sections])


def _section(effect: Effect, title: str) -> list[str]:
    kinds = [kind for kind in effect.kinds if effect not in library_effects() or effect in library_for(kind)]
    where = [(kind, effect.place_on(kind), effect.subsystem(kind)) for kind in kinds]
    places = "; ".join(dict.fromkeys(f"{kind.partition('-')[0]}: {place} ({of})" for kind, place, of in where))
    traits = [
        "takes energy only" if effect.dissipative else "",
        "keeps a state" if effect.memory else "",
        "" if effect.listed else "not listed",
    ]
    listed = [trait for trait in traits if trait]
    return [
        f"### {title}",
        "",
        effect.meaning,
        "",
        f"    {effect.equation}",
        "",
        f"- acts at {places}; regime: {effect.regime}" + (f"; {', '.join(listed)}" if listed else ""),
        *([f"- reads {'; '.join(_read(effect))}"] if effect.reads else []),
        f"- shows as {effect.shows}",
        f"- source: {effect.reference}",
        "",
        "| parameter | | unit of the numbers | bounds | scale | start | vanishes at |",
        "|---|---|---|---|---|---|---|",
        *(_row(effect, parameter, kinds) for parameter in effect.parameters),
        "",
    ]


def _read(effect: Effect) -> list[str]:
    return [f"{name}: {meaning.format(**words('hoist'))}" for name, meaning in effect.reads.items()]


def _row(effect: Effect, p: Parameter, kinds: Sequence[str]) -> str:
    off = "–" if p.vanishes_at is None else f"{p.vanishes_at:g}"
    meaning = p.meaning + (", each run's own" if p.per_run else "")
    bounds = f"{p.lowest:.4g} … {p.highest:.4g}"
    names = ", ".join(dict.fromkeys(f"`{p.named(kind)}`" for kind in kinds))
    return f"| {names} | {meaning} | {p.size} | {bounds} | {p.scale:g} | {p.start:g} | {off} |"


if __name__ == "__main__":
    print(page(), end="")
