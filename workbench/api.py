"""What `import workbench as wb` offers: each task as one function, which takes paths as well as records.

`machine` is a record or the path of its machine.yaml in each. How a result is shown stands in
`workbench.view`, found by `workbench.core.shown`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from workbench.analysis.linearise import Motion
from workbench.analysis.tune import Goal, TuneProgress, Weights
from workbench.analysis.usual import usual_controller
from workbench.control import Events, PiSettings, Settings
from workbench.core.errors import InputError, check_known
from workbench.core.yaml_strict import Document
from workbench.effects import check
from workbench.identify.identify import Identification
from workbench.identify.identify import identify as fit_machine
from workbench.logs import Campaign
from workbench.logs import read_campaign as read
from workbench.logs.doubts import doubts_of
from workbench.machines import STUDIED, Axis, Hoist, LinearAxis, RotaryAxis, default_hoist, load_of, of_kind, studied
from workbench.machines import load_machine as load
from workbench.references import LimitPair, Limits, Step, allowed_carriage_speed_m_s, motor_speed_rad_s, plan_motion
from workbench.simulate.loop import NO_EVENTS, LoopCase, LoopResult, simulate_loop
from workbench.simulate.lowpass import check_band
from workbench.simulate.models import check_multibody, simulate_multibody_loop
from workbench.simulate.replay import ReplayResult, replay_runs
from workbench.study.compare import Comparison, why_unmatched
from workbench.study.compare import compare as compare_rows
from workbench.study.load import Study, changed, load_study, plan_study, read_standalone
from workbench.study.loop_design import LoopAnalysis, Tuning, loop_case
from workbench.study.rows import Row, read_rows
from workbench.study.run import StudyResult, run_study

if TYPE_CHECKING:
    from workbench.diagnose.diagnose import Diagnosis
    from workbench.diagnose.progress import Progress as DiagnoseProgress

PathLike = str | os.PathLike[str]
Machine = Hoist | Axis | PathLike
M = TypeVar("M", Hoist, LinearAxis, RotaryAxis)
LEAD_S, SETTLE_S = 0.5, 2.0
PLANTS = ("lumped", "multibody")
USUAL_WEIGHTS = Weights()


def read_campaign(path: PathLike, *, runs: Sequence[str] | str | None = None) -> Campaign:
    """Read a campaign: a folder with machine.yaml, runs.yaml and logs.

    runs: names of the runs to read, all without it. InputError with file and place for what is wrong with the files.
    """
    return read(path, select=runs, check_effects=check)


def campaign_of(campaign: Campaign | PathLike, machine: Machine | None = None) -> Campaign:
    """The campaign, read where a path is given; `machine` in place of its own. InputError for another kind of one."""
    campaign = campaign if isinstance(campaign, Campaign) else read_campaign(campaign)
    machine = machine_of(machine)
    if machine is None:
        return campaign
    if type(machine) is not type(campaign.machine):
        kinds = type(machine).__name__, type(campaign.machine).__name__
        raise InputError(f"is a {kinds[0]}, expected a {kinds[1]} such as the campaign's", place="machine")
    return replace(campaign, machine=machine)


def load_machine(path: PathLike) -> Hoist | Axis:
    """The machine of a machine.yaml, its effects among those that are known. InputError with file, line and remedy."""
    return load(path, check_effects=check)


def machine_of(machine: Any) -> Hoist | Axis | None:
    """The machine, read where a path is given. InputError for what is neither."""
    if isinstance(machine, str | os.PathLike):
        return load_machine(machine)
    if machine is not None and not isinstance(machine, Hoist | Axis):
        said = f"is a {type(machine).__name__}, expected a machine or the path of its machine.yaml"
        raise InputError(said, place="machine")
    return machine


def with_effects(machine: M, effects: Mapping[str, Mapping[str, float]]) -> M:
    """The machine with effects beside those that it has: name -> parameters, as the block `effects` of machine.yaml.

    InputError for an effect or a parameter that there is not, with the nearest name.
    """
    changed = machine.model_copy(update={"effects": {**machine.effects, **effects}})
    check(changed)
    return changed


def replay(
    campaign: Campaign | PathLike, *, machine: Machine | None = None, band_hz: float | None = None
) -> ReplayResult:
    """Drive the machine's model with the measured torque (force) of every run; compare the speeds.

    machine: in place of the campaign's, such as an identified one. band_hz: band of the torque residual (−3 dB),
    chosen by the machine without it.
    """
    chosen = campaign_of(campaign, machine)
    check_band(band_hz, chosen.runs)
    return replay_runs(chosen.machine, chosen.runs, band_hz)


def identify(
    campaign: Campaign | PathLike,
    *,
    free: Sequence[str] | None = None,
    machine: Machine | None = None,
    band_hz: float | None = None,
    date: str = "",
) -> Identification:
    """Fit friction, masses and inertia of the campaign's machine to its runs.

    free: keys of machine.yaml to fit, the usual ones without it. machine: to start from, in place of the campaign's.
    date: when, for the machine's record. The result's `machine` goes into every other function.
    """
    chosen = campaign_of(campaign, machine)
    check_band(band_hz, chosen.runs)
    return fit_machine(chosen, free=free, band_hz=band_hz, date=date)


def diagnose(
    campaign: Campaign | PathLike,
    *,
    machine: Machine | None = None,
    candidates: Sequence[str] | None = None,
    most_effects: int = 5,
    baseline: str = "tolerances",
    validate: Sequence[str] = (),
    quick: bool = False,
    study: bool = True,
    scenario: Study | None = None,
    band_hz: float | None = None,
    seed: int = 0,
    tell: Callable[[DiagnoseProgress], None] | None = None,
) -> Diagnosis:
    """Find the effect that the machine of a campaign lacks: location, cause, probability, held-out residual.

    machine: to start from, in place of the campaign's. candidates: ids of the effects to weigh, the listed ones of the
    machine's kind without it. most_effects: that may be missing at once, 1 to 5. baseline: "tolerances" refits the base
    parameters with their tolerances as priors, "nominal" keeps them. validate: names of runs that no number is fitted
    to; the result states them apart. quick: names and places within seconds; no pairs, study, next run or law. study:
    whether to compute what changes in the control study, with the moves, limits, payloads and controller of scenario.
    band_hz: band of the torque residual (−3 dB). The same seed gives the same answer. tell: receives the progress.

    The result's `corrected` machine goes into `replay`, `study` and the rest. It shows what is doubtful in the logs;
    `save(folder)` keeps it, `open_diagnosis(folder)` reads it back. InputError where the runs cannot be diagnosed.
    """
    from workbench.diagnose.diagnose import diagnose as find_cause  # half of all that is imported

    chosen = campaign_of(campaign, machine)
    if not chosen.doubts:
        chosen = replace(chosen, doubts=tuple(doubts_of(chosen.machine, chosen.runs)))
    check_band(band_hz, chosen.runs)
    return find_cause(
        chosen, baseline=baseline, candidates=candidates, most_effects=most_effects, seed=seed, band_hz=band_hz,
        study=study, scenario=scenario, quick=quick, validate=validate, tell=tell,
    )  # fmt: skip


def open_diagnosis(folder: PathLike) -> Diagnosis:
    """A diagnosis that `Diagnosis.save` has kept in a folder. InputError where there is none, or it is damaged."""
    from workbench.diagnose.saved import FILE, read_diagnosis_file

    return read_diagnosis_file(Path(folder) / FILE)


def simulate(
    moves: float | Sequence[Step],
    *,
    machine: Hoist | PathLike | None = None,
    payload_kg: float = 0.0,
    start_position_m: float | None = None,
    limits: Limits | LimitPair | None = None,
    reference: str = "ruckig",
    controller: PiSettings | None = None,
    events: Events = NO_EVENTS,
    record_every: int = 10,
    plant: str = "lumped",
) -> LoopResult:
    """Move the carriage under the sampled speed loop, from rest to rest.

    moves: one distance in m (up positive), or a list of `Step`. Without them: the machine is the default hoist,
    the start a quarter up the rail, the controller `usual_controller`, the limits those of `usual_limits`.
    reference: trapezoid, ruckig or another kind. record_every: of the controller's samples one in so many is kept.
    plant: lumped or multibody; the second needs the extra 'multibody', takes seconds and gives forces of joints too.
    InputError for a motion that is not possible.
    """
    check_known("unknown plant", plant, PLANTS, place="plant")
    given = default_hoist() if machine is None else machine_of(machine)
    machine = studied(given)
    if machine is None:
        raise InputError(f"is {of_kind(given)}; a simulation is of {STUDIED}", place="machine")
    low, high = machine.rail.lowest_position_m, machine.highest_position_m
    start = low + 0.25 * (high - low) if start_position_m is None else start_position_m
    controller = usual_controller(machine) if controller is None else controller
    steps = moves if isinstance(moves, Sequence) else [Step(by_m=float(moves))]
    chosen = usual_limits(machine) if limits is None else limits
    plan = plan_motion(reference, steps, start, chosen, (low, high), LEAD_S, SETTLE_S, load_of(machine, payload_kg))
    carriage = plan.sample(controller.sample_time_s).speed_m_s
    speed = motor_speed_rad_s(carriage, machine.gearbox.ratio, machine.winch.drum_diameter_m)
    name = f"{payload_kg:g} kg, {reference}"
    case = LoopCase(name, machine, payload_kg, start, controller, speed, events)
    if plant == "multibody":
        check_multibody(machine)
        return simulate_multibody_loop(case, record_every=record_every)
    return simulate_loop([case], record_every=record_every)[0]


def usual_limits(machine: Hoist) -> Limits:
    """Nine tenths of the speed that the motors allow, reached in about 2 s: ramps of 1.2 s, jerk limited to 0.8 s."""
    ratio, drum = machine.gearbox.ratio, machine.winch.drum_diameter_m
    speed = 0.9 * allowed_carriage_speed_m_s(machine.motor.nominal_speed_rad_s, ratio, drum)
    return Limits(speed, speed / 1.2, speed / 1.2 / 0.8)


def study(
    scenario: PathLike | Mapping[str, Any] | Study, *, machine: Machine | None = None, **changes: Any
) -> StudyResult:
    """Run a scenario, every payload with every reference, and keep rows and signals in memory.

    scenario: a file, or the same keys as a dict. machine: in place of the scenario's. changes: other values of the
    scenario's keys, such as payloads_kg=[0, 9000]. InputError names the key or the place in the file.
    """
    given = machine_of(machine)
    planned = _planned(scenario, given)
    if given is not None or changes:
        new = changed(planned.scenario, changes)
        planned = plan_study(new, planned.machine if given is None else given, planned.recordings)
    return run_study(planned)


def _planned(scenario: PathLike | Mapping[str, Any] | Study, machine: Hoist | Axis | None) -> Study:
    if isinstance(scenario, Study):
        return scenario
    if not isinstance(scenario, Mapping):
        return load_study(scenario)
    hoist = default_hoist() if machine is None else machine
    data = {"name": "study", **scenario}
    return plan_study(read_standalone(Document(Path("the scenario"), data, {}), hoist), hoist)


def compare(a: StudyResult | PathLike, b: StudyResult | PathLike) -> Comparison:
    """Every metric of study b against study a, over the runs that both have; results or folders of results."""
    rows_a, rows_b = _rows(a), _rows(b)
    comparison = compare_rows(rows_a, rows_b)
    if not comparison.pairs:
        raise InputError(f"no run is in both studies: {why_unmatched(rows_a, rows_b)}")
    return comparison


def _rows(result: StudyResult | PathLike) -> Sequence[Row]:
    return result.rows if isinstance(result, StudyResult) else read_rows(Path(result))


def loop(
    machine: Machine | None = None,
    controller: Settings | None = None,
    *,
    payloads_kg: Sequence[float] | None = None,
    heights_m: Sequence[float] | None = None,
    motion: Motion = "hoisting",
    free_length: bool = False,
    ms_limit: float = 1.4,
    scenario: PathLike | None = None,
) -> LoopAnalysis:
    """Linearise the simulated speed loop, including drive and sampling, and compute its margins.

    Without them: the default hoist, a controller by rule, 0, 4500 and 9000 kg, heights at bottom, middle and top.
    scenario: a file that machine, controller and payloads are taken from. motion: hoisting, lowering or at_rest.
    free_length: stiffen the wire as its free length shortens.
    """
    Goal(ms_limit=ms_limit)
    case = loop_case(machine_of(machine), controller, payloads_kg, heights_m, scenario)
    return LoopAnalysis(case, tuple(case.members(motion, free_length)), ms_limit)


def tune(
    machine: Machine | None = None,
    controller: Settings | None = None,
    *,
    bandwidth_hz: float | None = None,
    ms_limit: float = 1.4,
    payloads_kg: Sequence[float] | None = None,
    heights_m: Sequence[float] | None = None,
    weights: Weights = USUAL_WEIGHTS,
    also: Sequence[str] = (),
    scenario: PathLike | None = None,
    tell: Callable[[TuneProgress], object] = lambda progress: None,
) -> Tuning:
    """Find kp, ki and the set-point weight: loop shaping first, then runs of the nonlinear closed loop.

    bandwidth_hz: of the slowest payload; without it the best rejection of load steps is sought. ms_limit: of the worst
    payload. controller: settings that stay as they are (filters, feed-forward). also: of notch, shaper,
    schedule. tell: receives the progress, and may raise to stop. InputError, with the reason, for a goal out of reach.
    """
    goal = Goal(bandwidth_hz, ms_limit)
    case = loop_case(machine_of(machine), controller, payloads_kg, heights_m, scenario)
    return Tuning(case, weights, case.tuned(goal, weights, also, tell))
