"""Several campaigns in one `diagnose`: here, or on the workers of a cluster, with one table at the end."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from workbench import __version__
from workbench.core.errors import InputError, one_line
from workbench.core.table import Column, Table, words
from workbench.core.whole_folder import check_free, whole_folder
from workbench.diagnose.diagnose import diagnose
from workbench.effects.loading import know
from workbench.effects.registry import UserFile
from workbench.logs import Campaign
from workbench.view.diagnosis import write_diagnosis
from workbench.view.numbers import NOTHING, figures


@dataclass(frozen=True)
class Answered:
    """One campaign's line of the table, and its files by name; trouble: why there is no answer."""

    name: str
    verdict: str = ""
    cause: str = ""
    probability: float = 0.0
    before: float = 0.0
    after: float = 0.0
    noise: float = 0.0
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

    A campaign that cannot be read or diagnosed is a row that says why; the others go on.
    """
    folders = {name: out / name for name in campaigns} if out is not None else {}
    for folder in folders.values():
        check_free(folder)
    read: dict[str, Campaign] = {}
    rows: dict[str, Answered] = {}
    for name, reader in campaigns.items():
        try:
            read[name] = reader()
        except InputError as error:
            rows[name] = Answered(name, "refused", trouble=one_line(str(error), 300))
    begun = time.monotonic()
    for name, row in _answers(read, (__version__, dict(options), out is not None, tuple(effects)), cluster):
        rows[name] = row
        if row.files:
            with whole_folder(folders[name]) as hidden:
                for file, content in row.files.items():
                    (hidden / file).write_bytes(content)
        done = sum(n in read for n in rows)
        left = (time.monotonic() - begun) / done * (len(read) - done)
        tell(f"{len(rows)}/{len(campaigns)} {name}: {row.cause or row.trouble}; about {left:.0f} s left")
    return [rows[name] for name in campaigns]


def _answers(
    campaigns: Mapping[str, Campaign], asked: tuple[Any, ...], cluster: str | None
) -> Iterator[tuple[str, Answered]]:
    if cluster is None:
        for name, campaign in campaigns.items():
            yield name, answered(name, campaign, *asked)
    elif campaigns:
        from workbench.study.cluster import client_on, each_on

        with client_on(cluster) as client:
            yield from each_on(client, cluster, list(campaigns), lambda name: (answered, name, campaigns[name], *asked))


def answered(
    name: str,
    campaign: Campaign,
    version: str,
    options: Mapping[str, Any],
    writes: bool,
    effects: Sequence[UserFile] = (),
) -> Answered:
    """On a worker, or here: the diagnosis of one campaign. Whatever goes wrong is a row."""
    try:
        if version != __version__:
            raise InputError(f"a worker has workbench {__version__}, expected {version}")
        for file in effects:
            know(file)
        files = {}
        if writes:
            with tempfile.TemporaryDirectory(prefix="workbench-diagnose-") as temporary:
                folder = Path(temporary) / "out"
                d = write_diagnosis(lambda: diagnose(campaign, **options), folder)
                files = {path.name: path.read_bytes() for path in folder.iterdir()}
        else:
            d = diagnose(campaign, **options)
    except InputError as error:
        return Answered(name, "refused", trouble=one_line(str(error), 300))
    except Exception as error:  # a defect in one campaign is no reason to lose the others
        return Answered(name, "failed", trouble=one_line(f"{type(error).__name__}: {error}", 300))
    cause = " + ".join(d.verdict.effects) or d.verdict.word.replace("_", " ")
    s = d.shrink
    return Answered(
        name, d.verdict.word, cause, d.verdict.probability, s.before, s.after, s.noise, s.unit, files=files
    )  # fmt: skip


def summary_table(rows: Sequence[Answered]) -> Table:
    columns = [words("campaign"), words("cause"), Column("proba-\nbility"), Column("before"), Column("after"),
               Column("noise"), words("unit")]  # fmt: skip
    shown = [
        [row.name, row.verdict, NOTHING, NOTHING, NOTHING, NOTHING, ""]
        if row.trouble
        else [row.name, row.cause, f"{row.probability:.2f}", figures(row.before), figures(row.after),
              figures(row.noise), row.unit]
        for row in rows
    ]  # fmt: skip
    return Table(columns, shown, "Before, after: rms of the residual on runs held out of the fit.")
