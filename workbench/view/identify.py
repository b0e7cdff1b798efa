"""An identification as people see it: tables, sentences, the paper's Figures 6 to 8, correlations, page and JSON."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.json_records import plain, rounded
from workbench.core.numbers import change_percent, figures, with_error
from workbench.core.run import Array
from workbench.core.shown import View
from workbench.core.table import Column, Table, words
from workbench.core.whole_folder import whole_folder, write_json
from workbench.identify.fit import Fit
from workbench.identify.identify import Identification, friction_speed
from workbench.identify.model import fittable, free_parameters
from workbench.logs import Campaign
from workbench.machines import Machine, get_value, kind_of, plant_of, save_machine
from workbench.simulate.driven import sensor
from workbench.simulate.lowpass import lowpass
from workbench.simulate.replay import ReplayResult
from workbench.study.labels import field_label
from workbench.view import replay as replay_view
from workbench.view.page import Section, save_page
from workbench.view.panels import Panels
from workbench.view.style import BLACK, BLUE, GREY, MARKERS, SPARE, VERMILLION, Figure, figure, line, look

FAR = 3.0  # tolerances: a value beyond them stands in for something else
ROW, AROUND = 34, 130  # px: of one value, and of title and axis
REMEDY = "`workbench diagnose` names what"
said = replay_view.said


# Tables, sentences, JSON.


def table(fit: Fit) -> Table:
    """One row for each fitted parameter."""
    columns = [words("parameter"), Column("nominal"), Column("identified"), Column("± std\nerror"),
               Column("change", "%"), words("held")]  # fmt: skip
    rows = [
        [free.key, figures(free.nominal, 4), *with_error(value, error), change_percent(free.nominal, value),
         "no" if free.prior_std is None else "yes"]
        for free, value, error in zip(fit.free, fit.value, fit.std_error, strict=True)
    ]  # fmt: skip
    return Table(columns, rows, said.held())


def keys_table(campaign: Campaign) -> Table:
    """Every key that can be fitted, its value, and whether the default fit includes it."""
    machine = campaign.machine
    usual = {free.key: free.prior_std is not None for free in free_parameters(machine, campaign.runs)}
    rows = [
        [key, figures(get_value(machine, key), 5), ("held" if usual[key] else "free") if key in usual else ""]
        for key in fittable(machine)
    ]
    return Table([words("key"), Column("value"), words("by default")], rows)


def measures_table(identification: Identification) -> Table:
    """The replay before and after."""
    machine, before, after = identification.machine, identification.before, identification.after
    rows = [("nominal", before), ("identified", after)]
    return replay_view.table_of_replays(machine, "machine", rows, after.band_hz)


def sentences(identification: Identification, remedy: str = REMEDY) -> list[str]:
    """The reduction of the residual, the paper's iteration, undetermined values, and the remedy."""
    i, machine, after = identification, identification.campaign.machine, identification.after
    kind = kind_of(machine)
    sentences = said.each("identified", i, kind.drive, kind.friction.unit, *kind.directions.names)
    sentences += i.fit.statements
    off, left, noise = max(i.fit.tolerances_off()), after.residual_rms_moving, after.noise_rms
    above = left > replay_view.EXPLAINED * noise > 0.0 and replay_view.noise_is_floor(i.machine, after)
    times = left / noise if above else 0.0
    lacks = [said.lacks(off if off > FAR else 0.0, times, remedy)] if off > FAR or times else []
    return [*sentences, *lacks]


def to_json(identification: Identification) -> dict[str, Any]:
    """identify.json: parameters with errors, correlations, the iteration's history, statements, replays."""
    i, fit, levels = identification, identification.fit, identification.levels
    kind = kind_of(i.campaign.machine)
    w, (forward, backward) = kind.drive, kind.directions.names
    return {
        "format": 1,
        "campaign": i.campaign.name,
        "runs": [run.name for run in i.campaign.runs],
        "parameters": {
            free.key: {"nominal": free.nominal, "value": rounded(value, 8), "std_error": rounded(error, 4),
                       "held_by_tolerance": free.prior_std is not None}
            for free, value, error in zip(fit.free, fit.value, fit.std_error, strict=True)
        },
        "correlation": {"keys": [free.key for free in fit.free], "matrix": plain(fit.correlation, 4)},
        "paper_iteration": {
            forward: plain(levels.forward), backward: plain(levels.backward), "settled": levels.settled
        },
        "statements": list(fit.statements),
        "fit": {f"{name}_{w.suffix}": rounded(getattr(fit, name))
                for name in ("residual_rms_before", "residual_rms", "noise_rms")}
        | {"samples": fit.samples, "evaluations": fit.evaluations},
        "before": replay_view.to_json(i.campaign, i.before)["overall"],
        "after": replay_view.to_json(_identified(i), i.after)["overall"],
        "notes": list(i.campaign.all_notes),
    }  # fmt: skip


def _identified(identification: Identification) -> Campaign:
    """The campaign with the identified machine in place of the nominal one."""
    return replace(identification.campaign, machine=identification.machine)


# Figures.


def law(machine: Machine, speed: Array) -> Array:
    """Friction (N, N m) at speeds (m/s, rad/s): the guide's on a hoist, Coulomb and viscous on an axis."""
    p = plant_of(machine).values(machine)
    return np.asarray(kind_of(machine).friction.law(speed, p), dtype=float)


def force_balance(machine: Machine, result: ReplayResult) -> tuple[Array, Array]:
    """Speed and friction force at the moving samples of all runs: the law plus the residual of the balance.

    On a hoist the residual torque is converted to a force at the carriage through gearbox, drum and the two falls.
    """
    kind, (gain, _) = kind_of(machine), sensor(machine)
    points = []
    for balance in (run.balance for run in result.runs):
        speed = friction_speed(kind, balance)
        both = lowpass(balance.run.time_s, np.column_stack([speed, law(machine, speed)]), balance.band_hz)
        both[:, 1] += balance.residual / gain / kind.transmission_of(machine)
        points.append(both[balance.moving])
    speed, force = np.concatenate(points).T
    return speed, force


def combined_weight(machine: Machine, result: ReplayResult) -> float | None:
    """The weight of carriage and payload, mean over the runs, by which the paper's Fig. 7 divides; None for an axis."""
    weight = kind_of(machine).weight
    return weight and weight(machine, float(np.mean([run.balance.run.payload_kg for run in result.runs])))


def friction(identification: Identification) -> Figure:
    """Fig. 7: the law before and after over speed, and the log's own points, small and grey.

    On a hoist over the weight of carriage and mean payload.
    """
    nominal, machine = identification.campaign.machine, identification.machine
    kind, weight = kind_of(machine), combined_weight(machine, identification.after)
    at, force = force_balance(machine, identification.after)
    # Many points near standstill, where the law turns over.
    half = 1.1 * float(np.max(np.abs(at), initial=1e-3)) * np.linspace(0.0, 1.0, 200) ** 3
    speed, over = np.concatenate([-half[:0:-1], half]), 1.0 if weight is None else weight
    quantity = "torque" if kind.friction.unit == "N m" else "force"
    head = "friction force / weight (–)" if weight else f"friction {quantity} ({kind.friction.unit})"
    panels = Panels("Friction law", [head], x_title=f"speed ({kind.moved.speed_unit})")
    # Every so many points, in order of speed: a cloud has no peaks that min-max thinning would keep.
    order = np.argsort(at)[:: max(len(at) // 1400, 1)]
    points = {"size": 4, "color": GREY, "opacity": 0.35}
    panels.line(0, 0, at[order], force[order] / over, "force balance of the log", {}, mode="markers", marker=points)
    dashed = {"color": BLACK, "dash": "6px,3px", "width": 2.0}
    panels.line(0, 0, speed, law(machine, speed) / over, "identified", line("simulated", width=2.4))
    panels.line(0, 0, speed, law(nominal, speed) / over, "nominal", dashed)
    return panels.figure(520)


def history(identification: Identification) -> Figure:
    """The friction levels over the paper's iterations, a line a level; iteration 0 is the start."""
    levels, unit = identification.levels, kind_of(identification.machine).friction.unit
    panels = Panels("Friction levels over the iterations", [f"level ({unit})"], x_title="iteration")
    both = zip(kind_of(identification.machine).directions.names, (levels.forward, levels.backward), strict=True)
    for number, (name, values) in enumerate(both):
        more = {"mode": "lines+markers", "marker": {"symbol": MARKERS[number], "size": 9}}
        panels.line(
            0, 0, np.arange(len(values), dtype=float), np.asarray(values), name, look(*SPARE[number], 2.0), unit, **more
        )
    return panels.figure(480).update_xaxes(tickmode="linear", dtick=max(1, len(levels.forward) // 12))


def correlation_matrix(names: Sequence[str], correlation: Array) -> Figure:
    """The fit's correlation matrix (m, m): what is near ±1 the data cannot tell apart."""
    heat = {
        "type": "heatmap", "z": correlation, "x": list(names), "y": list(names), "zmin": -1.0, "zmax": 1.0,
        # Blue, white, orange-red: Okabe and Ito's blue and vermillion as ends.
        "colorscale": [[0.0, BLUE], [0.5, "#FFFFFF"], [1.0, VERMILLION]], "texttemplate": "%{z:.2f}",
        "textfont": {"color": BLACK}, "colorbar": {"title": {"text": "correlation (–)"}},
        "hovertemplate": "%{y} and %{x}: %{z:.3f}<extra></extra>",
    }  # fmt: skip
    size, title = 220 + 48 * len(names), "Correlation of the fitted parameters"
    return figure(title, size, [heat], width=size + 160, yaxis={"autorange": "reversed"})


def estimates(fit: Fit) -> Figure:
    """A line a value, its distance from the nominal one with a standard error. In tolerances, with a grey band, where
    every value has one, as a hoist's usual fit does; else in per cent of the nominal value."""
    tolerance = 1.0 if all(free.prior_std is not None for free in fit.free) else None
    names, shifts, errors, values = list[str](), list[float](), list[float](), list[str]()
    for free, value, error in zip(fit.free, fit.value, fit.std_error, strict=True):
        if tolerance is None and not free.nominal:
            continue
        per, shift, spread = 0.01 * abs(free.nominal), value - free.nominal, error
        if tolerance is not None:
            per = free.scale * (free.prior_std or 1.0)
            if free.logarithmic:  # it moves by factors: its distance is that of the logarithms
                shift, spread = math.log(value / free.nominal), error / value
        label = field_label(f"machine.{free.key}")
        prefix, scale = ("G", 1e-9) if label.unit == "Pa" else ("", 1.0)
        names.append(label.words.replace("coulomb", "Coulomb").replace("youngs", "Young's"))
        values.append(f"{' ± '.join(with_error(scale * value, scale * error))} {prefix}{label.unit}".strip())
        shifts.append(shift / per)
        errors.append(spread / per)
    unit = "% of nominal" if tolerance is None else "tolerances"
    furthest = max((abs(shift) + error for shift, error in zip(shifts, errors, strict=True)), default=1.0)
    reach = 1.15 * max(furthest, tolerance or 0.0) or 1.0
    dots: dict[str, Any] = {
        "type": "scatter", "mode": "markers", "x": shifts, "y": names,
        "error_x": {"array": errors, "color": BLACK, "thickness": 2, "width": 6},
        "marker": {"color": BLUE, "size": 11}, "customdata": values,
        "showlegend": False, "hovertemplate": "%{y}: %{customdata}<extra></extra>",
    }  # fmt: skip
    words = [
        {"text": value, "x": 1.01, "xref": "paper", "xanchor": "left", "y": name, "showarrow": False,
         "font": {"size": 12}}
        for name, value in zip(names, values, strict=True)
    ]  # fmt: skip
    band = {
        "type": "rect", "x0": -(tolerance or 0.0), "x1": tolerance or 0.0, "y0": 0, "y1": 1, "yref": "paper",
        "layer": "below", "line": {"width": 0}, "fillcolor": GREY, "opacity": 0.18,
    }  # fmt: skip
    grey = "" if tolerance is None else "; grey: tolerance"
    across = {"title": {"text": f"distance from nominal ({unit})"}, "range": [-reach, reach], "zeroline": True}
    return figure(
        f"Identified values, ± one standard error{grey}", AROUND + ROW * max(len(names), 2), [dots],
        title_font_size=15, margin={"l": 12, "t": 52, "r": 164}, shapes=[] if tolerance is None else [band],
        annotations=words, xaxis=across | {"zerolinewidth": 2}, yaxis={"autorange": "reversed", "type": "category"},
    )  # fmt: skip


# The page.


def write_identification(run: Callable[[], Identification], folder: Path) -> Identification:
    """Identify, and write machine.yaml, replay.json for that machine, identify.json and identify.html."""
    with whole_folder(folder) as hidden:
        identification = run()
        save_machine(identification.machine, hidden / "machine.yaml")
        write_json(hidden / "replay.json", replay_view.to_json(_identified(identification), identification.after))
        write_json(hidden / "identify.json", to_json(identification))
        save_identify_page(identification, hidden / "identify.html")
    return identification


def save_identify_page(identification: Identification, path: Path) -> None:
    """Write the page of an identification; it needs no network."""
    i, machine, after = identification, identification.machine, identification.after
    drawn = [
        (replay_view.inputs(machine, after), said.inputs()),
        (friction(i), said.friction(combined_weight(machine, after))),
        (replay_view.speeds(machine, after), said.speeds()),
        (replay_view.residuals(machine, after, i.before), said.residuals()),
        (history(i), said.history()),
        (correlations(i), said.correlations()),
    ]
    text = [*sentences(i), *replay_view.notes_line(i.campaign)]
    section = Section(sentences=text, tables=[table(i.fit), measures_table(i)], figures=drawn)
    save_page([section], path, f"Identification of {machine.name} from campaign {i.campaign.name}")


def correlations(identification: Identification) -> Figure:
    return correlation_matrix([free.key for free in identification.fit.free], identification.fit.correlation)


# For notebooks.


def _columns(i: Identification) -> Mapping[str, Sequence[Any]]:
    return {
        "parameter": [free.key for free in i.fit.free],
        "nominal": [free.nominal for free in i.fit.free],
        "value": list(i.fit.value),
        "std_error": list(i.fit.std_error),
        "held_by_tolerance": [free.prior_std is not None for free in i.fit.free],
    }


VIEW = View(
    {"parameters": lambda i: table(i.fit), "replay": measures_table},
    {
        "friction": friction,
        "speed": lambda i: replay_view.speeds(i.machine, i.after),
        "residual": lambda i: replay_view.residuals(i.machine, i.after, i.before),
        "correlation": correlations,
    },
    _columns,
    index="parameter",
)
