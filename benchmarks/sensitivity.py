"""`python -m benchmarks.sensitivity FOLDER... --out ANSWERS --page benchmarks/verdict_numbers.md`: verdict numbers.

Every number of the verdict that is set by hand, or fitted once, with its reason and with the answers that are right
when it is 30 % smaller and larger. FOLDERs are sealed campaigns (`workbench blind`) that are open already. Each is
searched once; the search is judged again with each number. What is kept in ANSWERS stays, so that a stop loses little.
The list is taken from the code: numbers and the comments beside them.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest.mock import patch

from workbench.blind.make import mapped
from workbench.blind.measures import Row, Share, calibration_error, right, right_or_alike
from workbench.blind.run import load, save
from workbench.blind.score import open_all, sheet_of
from workbench.blind.seal import CAMPAIGNS
from workbench.core.table import Column, Table, words

if TYPE_CHECKING:
    from workbench.diagnose.hypotheses.evidence import Weighed
    from workbench.diagnose.hypotheses.free_parameters import Names
    from workbench.diagnose.hypotheses.search import SearchResult

ROOT = Path(__file__).resolve().parents[1]
PLACES = ("workbench/diagnose/hypotheses/settings.py", "workbench/diagnose/verdict")
FACTORS = (0.7, 1.3)
CALIBRATION = "calibration.json"
SHARE = "missed_"  # how names begin that are shares, 1 at most
# Why calibration.json has each number.
REASONS = {
    "missed_no_gap": "of answers of no gap, as stated: so many have a listed cause that is too small to see",
    "missed_unknown": "of unknown causes, as stated: so many are a listed one that the fits miss",
}


@dataclass(frozen=True)
class Number:
    """place: module or calibration.json. value: a number, or a container whose numbers are scaled together. reason: the
    comment beside it."""

    place: str
    name: str
    value: Any
    reason: str

    @property
    def key(self) -> str:
        return f"{self.place}:{self.name}"

    def times(self, factor: float) -> Any:
        changed_value = _times(self.value, factor)
        return min(changed_value, 1.0) if self.name.startswith(SHARE) else changed_value


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, Mapping):
        return {key: _times(part, factor) for key, part in value.items()}
    return max(round(value * factor), 1) if isinstance(value, int) else value * factor


def numbers() -> list[Number]:
    """In the order of the code; the calibration's first."""
    from workbench.diagnose.hypotheses.settings import stated

    listed = [Number(CALIBRATION, name, value, REASONS[name]) for name, value in stated().items()]
    for place in PLACES:
        path = ROOT / place
        for file in sorted(path.glob("*.py")) if path.is_dir() else [path]:
            listed += constants(file)
    return listed


def constants(file: Path) -> list[Number]:
    """Module-level names in capitals that are numbers, with the comment behind or above them."""
    text = file.read_text(encoding="utf-8")
    lines = text.splitlines()
    module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
    numbers = []
    for node in ast.parse(text).body:
        if not isinstance(node, ast.Assign) or not isinstance(target := node.targets[0], ast.Name):
            continue
        try:
            value = ast.literal_eval(node.value)
        except ValueError:
            continue
        if target.id.isupper() and _numeric(value):
            numbers.append(Number(module, target.id, value, _comment(lines, node.lineno - 1)))
    return numbers


def _numeric(value: Any) -> bool:
    if isinstance(value, Mapping):
        return bool(value) and all(map(_numeric, value.values()))
    return isinstance(value, int | float) and not isinstance(value, bool)


def _comment(lines: Sequence[str], at: int) -> str:
    _, mark, behind = lines[at].partition("#")
    if mark:
        return behind.strip()
    above: list[str] = []
    while at > 0 and lines[at - 1].startswith("#"):
        at -= 1
        above.insert(0, lines[at].lstrip("# "))
    return " ".join(above)


@contextmanager
def changed(number: Number, factor: float) -> Iterator[None]:
    """The number at `factor` of itself, and what its module derives from it."""
    if number.place == CALIBRATION:
        from workbench.diagnose.hypotheses.settings import stated

        kept = stated()
        kept[number.name] = number.times(factor)
        try:
            yield
        finally:
            kept[number.name] = number.value
        return
    module = importlib.import_module(number.place)  # no other module has imported the number by name
    now = {number.name: number.times(factor)}
    for node in ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and any(n.id in now for n in ast.walk(node.value) if isinstance(n, ast.Name)):
            exec(compile(ast.Module([node], []), number.place, "exec"), scope := {**vars(module), **now})
            now |= {target.id: scope[target.id] for target in node.targets if isinstance(target, ast.Name)}
    with patch.multiple(module, **now):
        yield


def judged_anew(campaigns: Path, listed: Sequence[Number], name: str) -> dict[str, Any]:
    """The search of one campaign judged with the numbers as they are, and with each one changed: key -> answers. As in
    a diagnosis, no cause is named whose correction makes held-out runs worse; what a cause does there is computed once.
    """
    from workbench.core.errors import InputError
    from workbench.diagnose import diagnose as whole
    from workbench.diagnose.verdict import judge
    from workbench.logs import read_campaign

    try:
        diagnosis = whole.diagnose(read_campaign(campaigns / name), study=False)
    except InputError:
        return {}
    search = diagnosis.search
    weigh = judge.bar
    harms: dict[Names, str] = {}

    def bar(search: SearchResult, w: Weighed) -> str:
        if w.names not in harms:
            harms[w.names] = weigh(search, w)
        return harms[w.names]

    def said() -> dict[str, Any]:
        with patch.object(judge, "bar", bar):
            judged = judge.judged_to_help(search)
        first = judged.ranking[0]
        return {
            "word": judged.word,
            "names": list(judged.names),
            "alike": list(judge.alike(search, judged)),
            "ranking": [[first.verdict, list(first.effects), first.probability]],
            "twins": [[list(names) for names in group] for group in judged.groups],
        }

    as_is = said()
    answers: dict[str, Any] = {"as it is": [as_is]}
    for number in listed:
        answers[number.key] = []
        for factor in FACTORS:
            with changed(number, factor):
                answers[number.key].append(said())
    return answers


def _kept(out: Path, listed: Sequence[Number], campaign: tuple[str, Path]) -> str:
    name, folder = campaign
    save(json.dumps(judged_anew(folder.parent, listed, folder.name)), out / f"{name}.json")
    return name


def table(rows: Sequence[Row], answers: Mapping[str, Mapping[str, Any]], listed: Sequence[Number]) -> Table:
    """A line for each number: place, value, reason; with it 30 % smaller and larger the answers that are right, those
    that are right or alike, and the calibration error; and the campaigns in which it changes anything."""
    those = [row for row in rows if answers.get(file_name(row))]

    def share(key: str, which: int) -> str:
        given = [{**row, **answers[file_name(row)][key][which]} for row in those if key in answers[file_name(row)]]
        exact, also = Share.counted(given, right), Share.counted(given, right_or_alike)
        return f"{exact.count}, {also.count} of {exact.of}; {calibration_error(given):.3f}" if exact.of else "–"

    def counts(number: Number) -> str:
        """In how many campaigns the answer or a probability is another one with it."""
        judged = [kept for row in those if number.key in (kept := answers[file_name(row)])]
        moved = sum(any(said != kept["as it is"][0] for said in kept[number.key]) for kept in judged)
        return f"{moved} of {len(judged)}" if judged else "–"

    as_is = share("as it is", 0)
    lines = [
        [
            n.name,
            n.place.removeprefix("workbench.diagnose."),
            _shown(n.value),
            n.reason,
            share(n.key, 0),
            share(n.key, 1),
            counts(n),
        ]
        for n in listed
    ]
    heads = [words("number"), words("where"), Column("value"), words("reason")]
    columns = [*heads, Column("30 % smaller"), Column("30 % larger"), Column("counts in")]
    note = f"Right, right or alike, and calibration error with all numbers as they are: {as_is}."
    return Table(columns, lines, note)


def _shown(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {_shown(part)}" for key, part in value.items())
    return f"{value:g}"


def file_name(row: Row) -> str:
    return str(row["folder"]).replace("/", "_")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", type=Path, nargs="+", help="sealed campaigns that were scored")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder for what was judged anew; what is there is kept"
    )
    parser.add_argument(
        "--count", type=int, help="campaigns of each folder, the first ones; 0: none, for the list alone"
    )
    parser.add_argument("--page", type=Path, help="page whose table is written anew")
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    if given.page and not given.page.is_file():
        parser.error(f"no page {given.page} to write the table on")
    scores = [score.with_rows(score.rows[: given.count]) for score in open_all(given.folders)]
    rows, listed = sheet_of(scores).rows, numbers()
    at = [score.folder / CAMPAIGNS / row["folder"] for score in scores for row in score.rows]
    todo = [(file_name(row), folder) for row, folder in zip(rows, at, strict=True)]
    todo = [(name, folder) for name, folder in todo if not (given.out / f"{name}.json").exists()]
    with mapped(given.processes) as over:
        for k, name in enumerate(over(partial(_kept, given.out, listed), todo), start=1):
            print(f"{k}/{len(todo)} {name}", flush=True)
    made = table(rows, load(given.out), listed)
    print(f"{made.markdown()}\n\n{made.note}")
    if given.page:
        write(given.page, made)


BEGIN = "<!-- made by python -m benchmarks.sensitivity -->"


def write(page: Path, made: Table) -> None:
    """What stands behind BEGIN on the page is replaced."""
    head, mark, _ = page.read_text(encoding="utf-8").partition(BEGIN)
    if not mark:
        raise SystemExit(f"{page} has no line {BEGIN}")
    page.write_text(f"{head}{BEGIN}\n\n{made.markdown()}\n\n{made.note}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
