"""What a study says: its decision, the number that it asks for, then at most three findings that could change it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from workbench.core.errors import InputError
from workbench.core.whole_folder import write_json
from workbench.study.arrow import parquet_bytes
from workbench.study.ask import Asked, answers, asked_sentences
from workbench.study.bound import from_the_bound
from workbench.study.decide import decisions, take_sentences
from workbench.study.findings import alarm, troubles, utilisation, variations
from workbench.study.load import Study
from workbench.study.rows import Row, index_table, read_table, rows_of
from workbench.study.run import StudyResult, peak_limit
from workbench.study.side import beside, on_another_damping

ANSWER, EQUAL_TIME = "answer.json", "equal_time.parquet"
MOST_FINDINGS = 3
MOST_BYTES = 1_000_000


@dataclass(frozen=True)
class Answer:
    """sentences: the decision first. beside: runs at equal times. asked: the numbers that the scenario asks for."""

    sentences: tuple[str, ...]
    beside: tuple[Row, ...] = ()
    asked: tuple[Asked, ...] = ()


def answer_of(study: Study, rows: Sequence[Row], *, simulate: bool = True) -> Answer:
    """simulate: runs beside the study may be made, for equal times, another damping and the number asked for."""
    rivals, asked = _run_beside(study) if simulate else ([], [])
    taken = take_sentences(decisions(rows, study.machine, study.scenario.decide, rivals))
    alarmed = alarm(utilisation(rows, study.machine))
    first = [*asked_sentences(study, asked), *taken, *([alarmed] if alarmed else [])]
    found = [*troubles(rows, peak_limit(study.machine)), *variations(rows, told=bool(taken))]
    if simulate and len(found) < MOST_FINDINGS and (damping := on_another_damping(study)) is not None:
        found.append(damping)
    if len(found) < MOST_FINDINGS and not study.scenario.sweep and not study.scenario.sample:
        found += from_the_bound(study)[:1]  # of the base values: a sweep has others
    return Answer((*first, *found[:MOST_FINDINGS]), tuple(rivals), tuple(asked))


def _run_beside(study: Study) -> tuple[list[Row], list[Asked]]:
    """A comparison that cannot be planned leaves the study's own rows as they are."""
    with suppress(InputError):
        return beside(study), answers(study)
    return [], []


def answer(study: Study, rows: Sequence[Row], *, simulate: bool = True) -> list[str]:
    """The sentences alone."""
    return list(answer_of(study, rows, simulate=simulate).sentences)


def write_answer(result: StudyResult, path: Path) -> None:
    """answer.json, and beside it the runs at equal times as an index of their own."""
    made = answer_of(result.study, result.rows)
    if made.beside:
        path.with_name(EQUAL_TIME).write_bytes(parquet_bytes(index_table(made.beside)))
    asked = [{**vars(one), "broken": list(one.broken)} for one in made.asked]
    write_json(path, {"format": 1, "sentences": list(made.sentences), "asked": asked})


def read_answer(folder: Path) -> Answer | None:
    """The answer that a result holds; None where it holds none that can be read."""
    file, rivals = folder / ANSWER, folder / EQUAL_TIME
    try:
        with file.open("rb") as stream:
            said = json.loads(stream.read(MOST_BYTES))
        rows = tuple(rows_of(read_table(rivals))) if rivals.is_file() else ()
        asked = tuple(Asked(**{**one, "broken": tuple(one["broken"])}) for one in said["asked"])
        return Answer(tuple(map(str, said["sentences"])), rows, asked)
    except (OSError, ValueError, KeyError, TypeError):
        return None
