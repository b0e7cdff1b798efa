"""`workbench diagnose`: where the sim-to-real gap lies, what causes it, how far it shrinks; one campaign or several."""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal

import click
import numpy as np

import workbench.diagnose.diagnose as cause
from workbench import __version__
from workbench.cli.measured import chosen_candidates, load_campaign
from workbench.cli.options import Band, MostEffects, Runs, command, names_in
from workbench.cli.show import filled, print_notes, print_sections, print_table
from workbench.cli.show import stages as shown
from workbench.core.errors import InputError, one_line
from workbench.core.input_file import read_input
from workbench.core.numbers import NOTHING, figures
from workbench.core.table import Column, Table, words
from workbench.core.whole_folder import check_free, whole_folder
from workbench.diagnose.diagnose import Diagnosis
from workbench.diagnose.hypotheses.settings import MOST_EFFECTS
from workbench.effects.loading import know
from workbench.effects.registry import UserFile, user_files
from workbench.logs import Campaign
from workbench.view.diagnosis import brief_sections, write_diagnosis

FILES = {
    "Report": "diagnose.html", "Machine": "machine.yaml", "Numbers": "diagnosis.json", "Next run": "next_run.csv",
    "The same as a scenario": "next_run.yaml", "Law": "law.py", "Machine with the law": "machine_law.yaml",
}  # fmt: skip


@command("diagnose", effects=True)
def diagnose(
    campaigns: Annotated[tuple[Path, ...], {"metavar": "CAMPAIGN..."}],
    *,
    out: Path | None = None,
    baseline: Literal["tolerances", "nominal"] = "tolerances",
    candidates: str | None = None,
    max_effects: MostEffects = MOST_EFFECTS,
    quick: bool = False,
    seed: Annotated[int, click.IntRange(min=0)] = 0,
    runs: Runs = None,
    validate: str | None = None,
    machine: Path | None = None,
    band: Band = None,
    scenario: Annotated[Path | None, "--study"] = None,
    cluster: Annotated[str | None, {"metavar": "ADDRESS"}] = None,
) -> None:
    """Find the effect that the machine of CAMPAIGN lacks: size, location and cause of the gap, and what remains.

    --out writes a report, diagnosis.json, and a corrected machine.yaml that replay and study accept. The exit
    status is 0 for every verdict. Several campaigns give one table, and with --out a folder of each; the exit status
    is 1 where one of them could not be diagnosed. Interrupted, the same command goes on with those that are left.

    out: New folder for diagnosis.json, machine.yaml and the report.
    baseline: Base parameters: refitted within their tolerances, or held at their nominal values.
    candidates: Candidate effects, separated by commas; 'all' includes the unlisted ones.
    quick: Names and places within seconds: single effects; no study, no next run, no law of an unknown cause.
    seed: Seed of random numbers; the same seed gives the same output.
    validate: Names of runs to keep for the end, separated by commas; nothing is fitted to them.
    machine: Another machine.yaml to start from.
    scenario: Scenario that gives moves, limits, payloads and controller of the control study.
    cluster: Several campaigns on Dask: tcp://host:port, or local:N for N processes.
    """
    if out is not None and (len(campaigns) == 1 or out.is_file()):
        check_free(out)
    if quick and (scenario is not None or max_effects not in (1, MOST_EFFECTS)):
        unused = "--study" if scenario is not None else "--max-effects"
        raise InputError(f"--quick weighs single effects and makes no control study; leave out {unused}, or --quick")
    options: dict[str, Any] = {
        "baseline": baseline, "most_effects": max_effects, "seed": seed, "quick": quick,
        "validate": names_in(validate), "band_hz": band,
        "scenario": None,
    }  # fmt: skip
    if scenario is not None:
        from workbench.study.load import load_study

        options["scenario"] = load_study(scenario)
    if len(campaigns) == 1 and cluster is None:
        read = load_campaign(campaigns[0], runs, machine, band)
        _one(read, {**options, "candidates": chosen_candidates(candidates, read.machine)}, out)
        return
    if candidates is not None:
        options["candidates"] = chosen_candidates(candidates, load_campaign(campaigns[0], runs, machine).machine)
    if missing := [path for path in campaigns if not path.exists()]:  # before any long work
        raise InputError("is not there", file=missing[0])
    names = [path.resolve().name for path in campaigns]
    if repeated := [name for name in names if names.count(name) > 1]:
        raise InputError(f"two campaigns are called '{repeated[0]}'; their results would share a folder")
    readers = {
        name: lambda path=path: load_campaign(path, runs, machine, band)
        for name, path in zip(names, campaigns, strict=True)
    }
    rows = diagnose_each(readers, options, out, cluster, user_files(), lambda line: click.echo(line, err=True))
    click.echo()
    print_table(summary_table(rows))
    for row in rows:
        if row.trouble:
            click.echo(filled(f"{row.name}: {row.trouble}", "- ", "  "))
    if out is not None:
        click.echo(f"\nReports: {', '.join(str(out / row.name) for row in rows if not row.trouble) or 'none'}")
    if any(row.trouble for row in rows):
        sys.exit(1)


def _one(read: Campaign, options: dict[str, Any], out: Path | None) -> None:
    print_notes(read.doubts)
    with shown(writes=out is not None) as (tell, writing):

        def run() -> Diagnosis:
            return cause.diagnose(read, **options, tell=tell)

        diagnosis = run() if out is None else write_diagnosis(run, out, writing)
    click.echo()
    print_sections(brief_sections(diagnosis))
    if out is None:
        click.echo("\nNothing is written without --out.")
    else:
        click.echo()
        for name, file in FILES.items():
            if (out / file).exists():
                click.echo(f"{name}: {out / file}")


# ---- several campaigns --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Answered:
    """One campaign's line of the table, and its files by name; trouble: why there is no answer."""

    name: str
    cause: str = ""
    numbers: Sequence[str] = (NOTHING,) * 4
    unit: str = ""
    trouble: str = ""
    files: Mapping[str, bytes] = field(default_factory=dict, repr=False)


def diagnose_each(
    campaigns: Mapping[str, Callable[[], Campaign]],
    options: Mapping[str, Any],
    out: Path | None,
    cluster: str | None,
    effects: Sequence[UserFile],
    tell: Callable[[str], None],
) -> list[Answered]:
    """The answers in the order of the campaigns. campaigns: name -> what reads it. out: a folder with one of each.

    Each is read when its turn comes. A campaign that cannot be read or diagnosed is a row that says why; the others go
    on. One that `out` has the answer of, to the same question, is not diagnosed again. InputError where a folder holds
    anything else, before any long work.
    """
    asked = (__version__, dict(options), out is not None, tuple(effects))
    rows: dict[str, Answered] = {}
    questions: dict[str, str] = {}

    def read(name: str) -> Campaign | None:
        try:
            campaign = campaigns[name]()
        except InputError as error:
            rows[name] = Answered(name, "refused", trouble=one_line(str(error), 300))
            tell(f"{len(rows)}/{len(campaigns)} {name}: {rows[name].trouble}")
            return None
        questions[name] = question_of(campaign, asked)
        return campaign

    for name, folder in [(name, out / name) for name in campaigns] if out is not None else []:
        if not (folder / ANSWER).exists():
            check_free(folder)
        elif read(name) is not None:
            rows[name] = kept = _kept(folder, questions[name])
            tell(f"{len(rows)}/{len(campaigns)} {name}: {kept.cause}; kept from before")
    begun, before = time.monotonic(), len(rows)
    waiting = ((name, found) for name in campaigns if name not in rows and (found := read(name)) is not None)
    try:
        for name, row in _answers(waiting, asked, cluster):
            rows[name] = row
            if out is not None and row.files:
                said = {"question": questions[name]} | {key: getattr(row, key) for key in KEPT}
                with whole_folder(out / name) as hidden:
                    for file, content in {**row.files, ANSWER: json.dumps(said).encode()}.items():
                        (hidden / file).write_bytes(content)
            left = (time.monotonic() - begun) / (len(rows) - before) * (len(campaigns) - len(rows))
            tell(f"{len(rows)}/{len(campaigns)} {name}: {row.trouble or row.cause}; about {left:.0f} s left")
    except KeyboardInterrupt:
        if out is not None:
            kept_now = sum(not row.trouble for row in rows.values())
            tell(f"{kept_now} of {len(campaigns)} are done and kept; the same command goes on with the others")
        raise
    return [rows[name] for name in campaigns]


ANSWER, KEPT = "answer.json", ("cause", "numbers", "unit")  # a campaign's line of the table, in its folder


def question_of(campaign: Campaign, asked: tuple[Any, ...]) -> str:
    """The hash of all that an answer depends on: machine, logs, options, users' effects, version."""
    version, options, _, effects = asked
    scenario = options["scenario"] and options["scenario"].fingerprint
    digest = sha256(campaign.machine.model_dump_json().encode())
    digest.update(repr((version, {**options, "scenario": scenario}, effects)).encode())
    for run in campaign.runs:
        digest.update(repr((run.name, run.payload_kg, run.start_position_m, run.start_time_s)).encode())
        for signal, values in sorted({"time_s": run.time_s, **run.signals}.items()):
            digest.update(signal.encode() + np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def _kept(folder: Path, question: str) -> Answered:
    """The line of an answer that the folder holds. InputError if it is that of another question, or damaged."""
    try:
        said = json.loads(read_input(folder / ANSWER, "json"))
        if said["question"] == question:
            return Answered(folder.name, *(said[key] for key in KEPT))
    except (ValueError, KeyError, TypeError) as error:
        problem = "is damaged, expected what `workbench diagnose` of several campaigns wrote"
        raise InputError(problem, file=folder / ANSWER) from error
    problem = "has an answer for other logs, options or another version; nothing is overwritten, choose another folder"
    raise InputError(problem, file=folder)


def _answers(
    campaigns: Iterator[tuple[str, Campaign]], asked: tuple[Any, ...], cluster: str | None
) -> Iterator[tuple[str, Answered]]:
    if cluster is None:
        yield from ((name, answered(name, campaign, *asked)) for name, campaign in campaigns)
    elif (first := next(campaigns, None)) is not None:
        from workbench.study.cluster import client_on, each_on

        held = dict[str, Campaign]()

        def names() -> Iterator[str]:
            for name, campaign in chain([first], campaigns):
                held[name] = campaign
                yield name

        with client_on(cluster) as client:
            yield from each_on(client, cluster, names(), lambda name: (answered, name, held.pop(name), *asked))


def answered(
    name: str, campaign: Campaign, version: str, options: Mapping[str, Any], writes: bool, effects: Sequence[UserFile]
) -> Answered:
    """On a worker, or here: the diagnosis of one campaign. Whatever goes wrong is a row."""
    try:
        if version != __version__:
            raise InputError(f"a worker has workbench {__version__}, expected {version}")
        for file in effects:
            know(file)
        with tempfile.TemporaryDirectory(prefix="workbench-diagnose-") as temporary:
            folder = Path(temporary) / "out"
            d = cause.diagnose(campaign, **options) if not writes else write_diagnosis(
                lambda: cause.diagnose(campaign, **options), folder
            )  # fmt: skip
            files = {path.name: path.read_bytes() for path in folder.iterdir()} if writes else {}
    except InputError as error:
        return Answered(name, "refused", trouble=one_line(str(error), 300))
    except Exception as error:  # a defect in one campaign is no reason to lose the others
        return Answered(name, "failed", trouble=one_line(f"{type(error).__name__}: {error}", 300))
    s = d.shrink
    numbers = (f"{d.verdict.probability:.2f}", *map(figures, (s.before, s.after, s.noise)))
    named = " + ".join(d.verdict.effects) or d.verdict.word.replace("_", " ")
    return Answered(name, named, numbers, s.unit, files=files)


def summary_table(rows: Sequence[Answered]) -> Table:
    columns = [words("campaign"), words("cause"), Column("proba-\nbility"), Column("before"), Column("after"),
               Column("noise"), words("unit")]  # fmt: skip
    note = "Before, after: rms of the residual on runs held out of the fit."
    return Table(columns, [[row.name, row.cause, *row.numbers, row.unit] for row in rows], note)
