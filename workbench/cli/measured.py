"""`workbench replay` and `identify`: a campaign's runs on the model; the model fitted to them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import click

from workbench.cli.options import Band, Measured, OtherMachine, Runs, command, names_in
from workbench.cli.show import print_notes, print_table, print_text
from workbench.core.errors import InputError, check_known
from workbench.core.whole_folder import check_free
from workbench.effects import check, effects_for
from workbench.logs import Campaign, read_campaign
from workbench.logs.campaign import RunsError
from workbench.logs.doubts import doubts_of
from workbench.machines import Machine, load_machine, plant_of
from workbench.simulate.lowpass import check_band
from workbench.simulate.replay import ReplayResult, replay_runs

ALL = "all"
MOST_NOTES = 5


def load_campaign(
    path: Path, runs: str | None = None, machine_file: Path | None = None, band_hz: float | None = None
) -> Campaign:
    """The campaign in `path`, with what is doubtful in it; runs: names separated by commas.

    InputError if they do not fit together.
    """
    machine = None if machine_file is None else load_machine(machine_file, check_effects=check)
    try:
        campaign = read_campaign(path, select=runs, check_effects=check)
    except RunsError as error:
        remedy = f"; without what is at fault: --runs {','.join(error.sound)}" if error.sound else ""
        raise InputError(error.problem + remedy, file=error.file, line=error.line, place=error.place) from error
    campaign = replace(campaign, doubts=tuple(doubts_of(campaign.machine, campaign.runs)))
    check_band(band_hz, campaign.runs)
    if machine is None:
        return campaign
    if type(machine) is not type(campaign.machine):
        said = f"is another kind of machine than the campaign's ({_kind(machine)}, expected {_kind(campaign.machine)})"
        raise InputError(said, file=machine_file)
    return replace(campaign, machine=machine)


def chosen_candidates(text: str | None, machine: Machine) -> tuple[str, ...] | None:
    """Names separated by commas; `all`: every effect of the machine's kind, also the unlisted ones. None stays None.

    InputError for an unknown or a repeated name, with the nearest valid one.
    """
    if text is None:
        return None
    known = effects_for(plant_of(machine).kind)
    if text.strip() == ALL:
        return tuple(known)
    names = names_in(text)
    if not names:
        raise InputError(f"no effect is named, expected names with commas between, or '{ALL}'", place="candidates")
    for name in names:
        check_known("unknown effect", name, known, place="candidates")
    if repeated := [name for name in names if names.count(name) > 1]:
        raise InputError(f"'{repeated[0]}' is named twice, expected each effect once", place="candidates")
    return tuple(names)


def _kind(machine: object) -> str:
    return " ".join(str(getattr(machine, key)) for key in ("motion", "kind") if hasattr(machine, key))


def print_first_notes(campaign: Campaign) -> None:
    """The first few of the reader's notes."""
    notes = campaign.all_notes
    more = len(notes) - MOST_NOTES
    print_notes([*notes[:MOST_NOTES], *([f"and {more} more notes like these"] if more > 0 else [])])


@command("replay", effects=True)
def replay(
    campaign: Measured, *, out: Path | None = None, runs: Runs = None, machine: OtherMachine = None, band: Band = None
) -> None:
    """Replay the runs of CAMPAIGN.

    The measured torque (force) drives the model. The simulated speed is compared with the measured speed, open
    loop and restarted every 2 s, and the measured torque with the torque that the measured motion requires.

    out: New folder for replay.json and replay.html.
    """
    from workbench.view import replay as replay_view

    check_free(out)
    read = load_campaign(campaign, runs, machine, band)

    def run() -> ReplayResult:
        return replay_runs(read.machine, read.runs, band)

    result = run() if out is None else replay_view.write_replay(run, read, out)
    print_first_notes(read)
    print_table(replay_view.table(read.machine, result))
    print_text(["", *replay_view.sentences(read.machine, result)])
    if out is not None:
        click.echo(f"\nFigures: {out / 'replay.html'}\nNumbers: {out / 'replay.json'}")


@command("identify", effects=True)
def identify(
    campaign: Measured,
    *,
    out: Path | None = None,
    free: str | None = None,
    runs: Runs = None,
    machine: OtherMachine = None,
    band: Band = None,
    list_keys: Annotated[bool, "--list"] = False,
) -> None:
    """Fit the machine of CAMPAIGN to its runs; print values with standard errors.

    --out writes the identified machine.yaml, which every other command accepts, with figures and numbers.

    out: New folder for machine.yaml, numbers and figures.
    free: Keys of machine.yaml to fit, separated by commas. Default: see --list.
    list_keys: Print the keys that --free accepts, and exit.
    """
    from workbench.identify.identify import Identification
    from workbench.identify.identify import identify as fit
    from workbench.view import identify as identify_view

    check_free(out)
    read = load_campaign(campaign, runs, machine, band)
    if list_keys:
        print_table(identify_view.keys_table(read))
        return
    keys = None if free is None else [key.strip() for key in free.split(",")]

    def run() -> Identification:
        return fit(read, free=keys, band_hz=band)

    found = run() if out is None else identify_view.write_identification(run, out)
    print_first_notes(read)
    print_table(identify_view.table(found.fit))
    click.echo()
    print_table(identify_view.measures_table(found), note=False)
    print_text(["", *identify_view.sentences(found)])
    if out is None:
        click.echo("\nNothing is written without --out.")
    else:
        click.echo(f"\nMachine: {out / 'machine.yaml'}\nFigures: {out / 'identify.html'}")
        click.echo(f"Numbers: {out / 'identify.json'}, {out / 'replay.json'}")


# `workbench import`: logs as drives write them, made a campaign.


@command("import", effects=True)
def import_(
    files: Annotated[tuple[Path, ...], {"metavar": "FILE..."}],
    *,
    machine: Path,
    out: Path,
    payload: tuple[float, ...] = (),
    start_position: tuple[float, ...] = (),
    mapped: Annotated[tuple[str, ...], "--map", {"metavar": "SIGNAL=COLUMN[:UNIT]"}] = (),
    scales: Annotated[tuple[str, ...], "--scale", {"metavar": "SIGNAL=FACTOR"}] = (),
    runs_csv: Annotated[Path | None, "--runs"] = None,
    yes: bool = False,
) -> int:
    """Make a campaign of logs: MDF4, TDMS, MAT 7.3, TwinCAT Scope and other CSV with header lines or decimal commas.

    The command proposes a mapping of columns to signals, draws it, and asks for confirmation unless --yes is given.
    Channels of different rates are resampled to the fastest one. MDF4, TDMS and MAT 7.3 need the extra 'import'.

    machine: The machine.yaml of the campaign.
    out: New folder for the campaign.
    payload: Payload in kg: one value for all files, or one for each.
    start_position: Height at the first sample, in m: one value for all files, or one for each.
    mapped: Column to use for a signal, and its unit (rpm, mm, kNm, %nominal …); may be repeated.
    scales: Signal in SI = factor times column; may be repeated.
    runs_csv: CSV with one row per file: file, and any of payload_kg, start_position_m, start_time_s.
    yes: Accept the proposed mapping without asking.
    """
    from workbench.logs import importing
    from workbench.view.logs import mapping_table, write_page

    check_free(out)
    read = load_machine(machine, check_effects=check)
    loads = importing.for_all(payload, len(files), "payload")
    starts = importing.for_all(start_position, len(files), "start_position")
    logs = [
        importing.Imported(file, tuple(importing.read_channels(file)), load, start)
        for file, load, start in zip(files, loads, starts, strict=True)
    ]
    if runs_csv is not None:
        logs = importing.with_table(logs, runs_csv)
    proposed = importing.propose(read, logs[0].channels, mapped, scales)
    page = out.with_name(f"{out.name}.import.html")
    signals = [(p.signal, p.column, *importing.in_si(p, logs[0])) for p in proposed.proposals]
    write_page(signals, proposed, logs[0].name, page)
    print_table(mapping_table(proposed))
    print_text([f"Columns that are no signal: {', '.join(proposed.unused) or 'none'}.", f"Drawn: {page}"])
    if not yes:
        click.echo(f"\nruns.yaml will be:\n\n{importing.runs_yaml(logs, proposed)}")
        click.confirm("Take it?", abort=True)
    campaign = importing.write_campaign(machine, logs, proposed, out)
    print_text([f"Runs: {len(campaign.runs)}.", *campaign.all_notes])
    click.echo(f"\nCampaign: {out}")
    return 0
