"""A replay as a table, as sentences that help to read it, and as replay.json."""

from __future__ import annotations

from typing import Any

from workbench.core.json_records import rounded
from workbench.core.table import Column, Table, words
from workbench.logs import Campaign
from workbench.machines import Axis, Hoist, kind_of
from workbench.simulate.replay import Replay, ReplayResult
from workbench.view.numbers import MOST, figures
from workbench.view.words import words_of

PAPER_PERCENT = 7.49  # RMSE of the paper's own machine, its Figure 8
EXPLAINED = 1.3  # times the noise: what is left while moving is then little more than noise


def table(machine: Hoist | Axis, result: ReplayResult) -> Table:
    """A line a run, and one for all."""
    rows = [measures(run.name, run, run.balance.noise_rms) for run in result.runs]
    if len(rows) > 1:
        rows.append(measures("all runs", result, result.noise_rms))
    return Table(columns(machine, "run"), rows, note(machine, result))


def columns(machine: Hoist | Axis, first: str) -> list[Column]:
    """The columns of `measures`, and before them one of names."""
    w = words_of(machine)
    return [
        words(first), Column("speed error\nopen loop", "%"), Column("speed error\nrestarted", "%"),
        Column(f"{w.quantity}\nresidual", w.unit), Column("the same,\nmoving", w.unit),
        Column("sensor\nnoise", w.unit),
    ]  # fmt: skip


def _percent(value: float) -> str:
    """Two decimals; of a replay that diverges three digits and an exponent."""
    return f"{value:.2f}" if abs(value) < MOST else figures(value)


def measures(name: str, replay: Replay | ReplayResult, noise_rms: float) -> list[str]:
    """The row of a run, or of all: speed errors, residuals, noise."""
    return [
        name,
        _percent(replay.speed_rmse_percent),
        _percent(replay.speed_rmse_percent_restarted_2s),
        figures(replay.residual_rms),
        figures(replay.residual_rms_moving),
        figures(noise_rms),
    ]


def note(machine: Hoist | Axis, result: ReplayResult) -> str:
    """How the columns are made."""
    w = words_of(machine)
    return (
        f"All rms. Speed errors in per cent of {w.scale}; restarted: set back to the measured motion every 2 s. "
        f"Residual: measured minus predicted {w.quantity}, both below {result.band_hz:.3g} Hz; moving: without rests; "
        f"noise: that of the logged {w.quantity} in this band."
    )


REMEDY = "`workbench identify` fits the values, `workbench diagnose` names what the model lacks."


def sentences(machine: Hoist | Axis, result: ReplayResult, remedy: str = REMEDY) -> list[str]:
    """What these figures say of the model, the drifting one first. remedy: what to do where it explains too little."""
    return [_open_loop(machine, result), _residual(machine, result, remedy)]


def _open_loop(machine: Hoist | Axis, result: ReplayResult) -> str:
    percent = f"{figures(result.speed_rmse_percent)} %"
    first = f"Open loop the model is {percent} off; the paper has {PAPER_PERCENT} % for its own machine."
    kind = kind_of(machine)
    if kind.nominal_speed is None:
        return f"{first} That figure adds up every bias from the run's first sample on: judge by the residual."
    run = result.runs[0].simulated
    drift = 100.0 * 10.0 / kind.rigid(machine, run.payload_kg).inertia / kind.nominal_speed(machine)
    return (
        f"{first} That figure adds up every bias: 1 {kind.drive.unit} of {kind.drive.quantity} that the model "
        f"does not know moves the speed by {drift:.1f} % within 10 s. Judge by the other columns."
    )


def _residual(machine: Hoist | Axis, result: ReplayResult, remedy: str) -> str:
    w = words_of(machine)
    moving, noise = result.residual_rms_moving, result.noise_rms
    if not moving > 0.0:
        return "The machine never moves in these runs: they say nothing of friction or inertia."
    if not noise_is_floor(machine, result):
        return (
            f"The {w.quantity} residual is {_percent(result.residual_percent)} % of the {w.quantity} itself. "
            "Its floor lies above the noise given: that of the position, differentiated twice, comes on top."
        )
    if moving <= EXPLAINED * noise:
        return f"While moving, the residual is {moving / noise:.1f} times the noise: the model explains these runs."
    return (
        f"While moving, the residual is {moving / noise:.1f} times the noise: values are off, or the model lacks "
        f"something. {remedy}"
    )


def noise_is_floor(machine: Hoist | Axis, result: ReplayResult) -> bool:
    """Whether the noise is what a perfect model leaves: not where the speed is the logged position's derivative."""
    return kind_of(machine).plant.speeds[0] in result.runs[0].balance.run


def to_json(campaign: Campaign, result: ReplayResult) -> dict[str, Any]:
    """replay.json: the keys of the format, and beside them the residual while moving, the noise and the notes."""
    machine = campaign.machine
    result_json: dict[str, Any] = {
        "format": 1,
        "campaign": campaign.name,
        "machine": machine.name,
        "runs": [{"name": run.name} | _measures_json(machine, run, run.balance.noise_rms) for run in result.runs],
        "overall": _measures_json(machine, result, result.noise_rms),
    }
    result_json["overall"] |= {
        f"{words_of(machine).quantity}_residual_percent": rounded(result.residual_percent),
        "band_hz": rounded(result.band_hz),
    }
    return result_json | {"notes": list(campaign.all_notes)}


def _measures_json(machine: Hoist | Axis, replay: Replay | ReplayResult, noise_rms: float) -> dict[str, float | None]:
    w = words_of(machine)
    return {
        "speed_rmse_percent": rounded(replay.speed_rmse_percent),
        "speed_rmse_percent_restarted_2s": rounded(replay.speed_rmse_percent_restarted_2s),
        f"{w.quantity}_residual_rms_{w.suffix}": rounded(replay.residual_rms),
        f"{w.quantity}_residual_rms_moving_{w.suffix}": rounded(replay.residual_rms_moving),
        f"noise_rms_{w.suffix}": rounded(noise_rms),
    }
