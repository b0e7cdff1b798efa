"""The watch at work: what has arrived, estimate, judge, store, diagnose, tell."""

from __future__ import annotations

import contextlib
import hashlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from workbench.core.errors import InputError, UnwritableError, nearest
from workbench.core.names import unit_of
from workbench.core.record import Finite, Payload, Position, Record
from workbench.core.run import Run
from workbench.core.yaml_strict import load, validate
from workbench.logs.campaign import Campaign, Column, read_run, read_runs
from workbench.logs.formats.opening import suffixes
from workbench.logs.raw_run import Entry, Name
from workbench.machines import Machine, get_value, kind_of
from workbench.watch.estimate import WINDOW, Baseline, estimate, watched_keys
from workbench.watch.judge import SAME_PAYLOAD_KG, Alarm, Cause, Cycle, Judge, Rules
from workbench.watch.opcua import Line
from workbench.watch.store import Store, digest_of


class Beside(Record):
    """The file beside a log."""

    payload_kg: Payload | None = None
    start_position_m: Position | None = None
    start_time_s: Finite | None = None
    name: Name | None = None


@dataclass(frozen=True)
class Arrived:
    """A log that is complete. entry: its description; None: there is none yet, or a wrong one, with its problem."""

    file: Path
    entry: Entry | None
    problem: str = ""


class Arrivals:
    """Looks into a folder again and again. A log is complete when it has not changed for `settle_s`."""

    def __init__(self, folder: Path, machine: Machine, settle_s: float) -> None:
        if not folder.is_dir():
            raise InputError("is no folder; expected one that logs come into", file=folder)
        self._folder, self._machine, self._settle_s = folder, machine, settle_s
        self._runs, self._kind = folder / "runs.yaml", kind_of(machine)
        self._seen: dict[Path, tuple[tuple[int, ...], float]] = {}
        self._done: dict[Path, tuple[int, ...]] = {}
        self.columns: Mapping[str, Column] = {}

    def look(self, now: float) -> tuple[list[Arrived], int]:
        """The logs that are complete and not yet `done`, in order of their names; how many still change.

        InputError where runs.yaml is wrong; it may be complete at the next look. What is wrong with the file beside a
        log is that log's problem alone.
        """
        entries: dict[str, Entry] = {}
        if self._runs.is_file():
            described, _ = read_runs(self._runs, self._machine)
            self.columns = described.columns
            entries = {Path(entry.file).name: entry for entry in described.runs}
        complete, waiting = [], 0
        for file in sorted(self._folder.iterdir()):
            if file.name.startswith(".") or file.suffix.lower() not in suffixes() or not file.is_file():
                continue
            # A log that was set aside for what stands beside it is looked at again when that changes.
            sign = (*_sign(file), *_sign(_beside(file)))
            if not sign or self._done.get(file) == sign:
                continue
            if self._seen.get(file, (None, 0.0))[0] != sign:
                self._seen[file] = sign, now
            if now - self._seen[file][1] < self._settle_s or sign[0] == 0:
                waiting += 1
                continue
            try:
                complete.append(Arrived(file, entries.get(file.name) or self._described(file)))
            except InputError as error:
                complete.append(Arrived(file, None, str(error)))
        return complete, waiting

    def done(self, file: Path) -> None:
        """Not to be looked at again unless it changes."""
        self._done[file] = self._seen[file][0]

    def _described(self, file: Path) -> Entry | None:
        """By the file beside it; None where there is none and one is needed."""
        kind, beside = self._kind, _beside(file)
        if not beside.is_file():
            return entry_of(file, file.stem) if not kind.payload and kind.start is None else None
        said = validate(Beside, load(beside))
        if kind.payload and said.payload_kg is None:
            raise InputError("needs payload_kg, in kg and at least 0", file=beside, place="payload_kg")
        if kind.start is not None and said.start_position_m is None:
            raise InputError(f"needs start_position_m, {kind.start.said}", file=beside, place="start_position_m")
        return entry_of(file, said.name or file.stem, **said.model_dump(exclude={"name"}))

    def read(self, arrived: Arrived) -> Run:
        """The log, checked and repaired as a campaign's. InputError for what is wrong with it."""
        assert arrived.entry is not None
        machine = self._machine
        (run,), _ = read_run(arrived.entry, arrived.file, machine, self.columns, None, self._runs, whole=True)
        return run


def _beside(file: Path) -> Path:
    return file.with_name(f"{file.name}.yaml")


def _sign(file: Path) -> tuple[int, ...]:
    """Changes when a file does; () where it is gone."""
    with contextlib.suppress(OSError):
        state = file.stat()
        return state.st_size, state.st_mtime_ns
    return ()


def entry_of(file: Path, name: str, **said: float | None) -> Entry:
    """InputError for what no entry of runs.yaml may be: a file's name may hold any sign."""
    try:
        return Entry.model_validate({"name": name, "file": file.name, **said})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        reason = f"cannot be a run's: {first['input']!r:.60}, {first['msg']}"
        raise InputError(reason, file=file, place=".".join(map(str, first["loc"]))) from error


# The watch at work: what has arrived, estimate, judge, store, diagnose, tell.


Say = Callable[[str], None]
Effects = Mapping[str, Mapping[str, float]]
Diagnoser = Callable[[Campaign, Baseline, Sequence[Cycle], Effects], Mapping[str, Any]]
FRICTION_LIMIT = 1.5  # of the identified level, where the user names no limit
MOST_DIAGNOSED = 4  # cycles since the onset that go into a diagnosis
HOOK_S = 5.0


@dataclass(frozen=True)
class Told:
    """One alarm in words, as the webhook and the terminal have it."""

    cycle: int
    name: str
    onset: int
    sentence: str
    causes: tuple[Cause, ...]
    diagnosis: dict[str, Any] | None
    cycles_left: float | None
    cycles_left_ci95: tuple[float, float] | None


class Watch:
    """One machine's logs and state. Built anew after a restart, it goes on where the store ends."""

    def __init__(
        self, folder: Path, machine: Machine, state: Path, rules: Rules, *, settle_s: float = 2.0,
        line: Line | None = None, diagnose: Diagnoser | None = None, hook: str | None = None,
        say: Say = lambda line: None, wait_s: float = 0.0, page: Callable[[Watch, Path], None] | None = None,
    ) -> None:  # fmt: skip
        """line: what writes logs into the folder. diagnose: asked about each new alarm; None: nobody is. hook: address
        that each new alarm is posted to. wait_s: how long another watch of this state is waited for. page: writes the
        page, whenever there is something new."""
        self.machine, self.rules = machine, with_usual_limits(machine, rules)
        self._arrivals = Arrivals(folder, machine, settle_s)
        self.store = Store(state, machine, rules, wait_s=wait_s, say=say)
        self._diagnose, self._hook, self._say, self._line, self._page = diagnose, hook, say, line, page
        self._said_once: set[str] = set()
        self.trouble: UnwritableError | None = None
        self._stale = True  # whether there is more in the store than in its copies
        try:
            self._judge_anew()
        except BaseException:
            self.close()
            raise

    def _judge_anew(self) -> None:
        """By what the store has."""
        self.judge = Judge(self.rules)
        for cycle in self.store.cycles():
            self.judge.add(cycle)
        if list(self.store.said()) != [alarm.cycle for alarm in self.judge.alarms]:
            self.store.damaged("its alarms are not those of its cycles")

    def close(self) -> None:
        if self._line is not None:
            self._line.close()
        self.store.close()

    @property
    def alarms(self) -> list[Alarm]:
        """The first alarm of each change."""
        return [alarm for alarm in self.judge.alarms if not alarm.again]

    def look(self, now: float) -> tuple[int, int]:
        """Takes what is complete; how many cycles were new, and how many logs are still waited for.

        Where nothing can be written (`trouble`) it is tried again at the next look, and nothing is lost.
        """
        before = len(self.judge.cycles)
        try:
            waiting = self._take_all(now)
            self._finish()
            if self._stale:
                self.store.write_copies()
                if self._page is not None:
                    self._page(self, self.store.folder / "watch.html")
                self._stale = False
        except UnwritableError as error:
            if self.trouble is None:
                self._say(f"{error}; it is tried again at each look")
            self.trouble, waiting = error, 1
        else:
            if self.trouble is not None:
                self._say(f"{self.store.folder}: there is room again; the watch goes on")
            self.trouble = None
        return len(self.judge.cycles) - before, waiting

    def _take_all(self, now: float) -> int:
        """Takes what is complete; how many logs are still waited for."""
        while self._line is not None and not self._line.notes.empty():
            note = self._line.notes.get()
            if note.key:  # a cycle that was spoilt is kept as one that does not count
                self.store.refuse(note.key, note.name, f"{note.name}: {note.text}")
            self._say(f"not counted: {note.name}: {note.text}" if note.key else note.text)
        try:
            complete, waiting = self._arrivals.look(now)
        except InputError as error:
            self._once(str(error))
            return 1
        for arrived in complete:
            if arrived.entry is None and not arrived.problem:
                self._once(f"{arrived.file.name}: waits for its entry in runs.yaml or for {arrived.file.name}.yaml")
                waiting += 1
            else:
                self._take(arrived)
        return waiting

    def _take(self, arrived: Arrived) -> None:
        file = arrived.file
        try:
            digest = digest_of(file)
        except (OSError, InputError) as error:
            self._once(f"{file}: cannot be read: {error.strerror}" if isinstance(error, OSError) else str(error))
            return
        described = arrived.problem if arrived.entry is None else arrived.entry.model_dump_json()
        aside = hashlib.sha256(f"{digest} {described}".encode()).hexdigest()
        if not self.store.known(digest, aside):
            try:
                if arrived.entry is None:
                    raise InputError(arrived.problem)
                run = self._arrivals.read(arrived)
                made = estimate(self.machine, run)
            except InputError as error:
                self.store.refuse(aside, file.name, str(error))
                self._say(f"not counted: {error}")
            else:
                of_log = digest, str(file.resolve()), run.start_position_m, run.notes
                self._add(Cycle(run.name, run.payload_kg, run.start_time_s, run.duration_s, made, *of_log))
        self._arrivals.done(file)

    def _add(self, cycle: Cycle) -> None:
        """Judges a cycle, writes it, and tells of it. UnwritableError: it is as if it had not been there."""
        judged = self.judge.add(cycle)
        self._stale = True
        try:
            self.store.add(len(self.judge.cycles) - 1, cycle, judged)
        except UnwritableError:
            self._judge_anew()
            raise
        for event in judged.events:
            self._say(f"{cycle.name}: {event.text}")
        if judged.alarm is not None and not judged.again:
            self._say(f"ALARM {self.told(judged.alarm).sentence}")

    def _finish(self) -> None:
        """Alarms that nobody has diagnosed or told yet: of now, or of before a restart. A change is diagnosed when it
        alarms, beside what earlier alarms found; where no cause was named, again after 1, 2, 4, ... repeats."""
        for alarm in self.alarms if self._diagnose is not None else ():
            said, repeats = self.store.said()[alarm.cycle], self._repeats(alarm)
            asked = (said.diagnosis or {}).get("repeats", 0)
            named = (said.diagnosis or {}).get("verdict") == "named"
            if said.diagnosis is None or (not named and len(repeats) >= max(1, 2 * asked)):
                try:
                    answer = dict(self._asked(alarm.onset, [alarm, *repeats][-1].cycle, self._explained(alarm)))
                except InputError as error:
                    answer = {"verdict": None, "effects": [], "sentence": f"not diagnosed: {error}"}
                answer["repeats"] = len(repeats)
                self.store.say(alarm.cycle, said.model_copy(update={"diagnosis": answer}))
                self._stale = True
                name = self.judge.cycles[alarm.cycle].name
                self._say(f"diagnosis of the alarm at {name}: {answer['sentence']}")
        for alarm in self.alarms if self._hook is not None else ():
            said = self.store.said()[alarm.cycle]
            if not said.told and self._post(self.told(alarm)):
                self.store.say(alarm.cycle, said.model_copy(update={"told": True}))
                self._stale = True

    def _repeats(self, alarm: Alarm) -> list[Alarm]:
        """The alarms that followed for the same change."""
        later = [other for other in self.judge.alarms if other.cycle > alarm.cycle]
        end = next((i for i, other in enumerate(later) if not other.again), len(later))
        return later[:end]

    def _explained(self, alarm: Alarm) -> Effects:
        """The effects of the alarms before this one, fitted anew to the cycles just before its onset: they may have
        gone on."""
        effects: Effects = {}
        for earlier in self.alarms:
            found = self.store.said()[earlier.cycle].diagnosis
            if earlier.cycle >= alarm.cycle or earlier.onset >= alarm.onset or (found or {}).get("verdict") != "named":
                continue
            assert found is not None
            effects = {**effects, **found.get("fitted", {})}
            others = {name: values for name, values in effects.items() if name not in found["effects"]}
            anew = self._asked(earlier.onset, alarm.onset - 1, others)
            effects = {**effects, **(anew.get("fitted", {}) if anew["effects"] == found["effects"] else {})}
        return effects

    def _asked(self, first: int, last: int, explained: Effects) -> Mapping[str, Any]:
        """The diagnosis of the cycles from `first` to `last`."""
        assert self._diagnose is not None and self.judge.baseline is not None
        since = [self.judge.cycles[k] for k in self.judge.counted if first <= k <= last]
        runs = tuple(self._read_again(cycle) for cycle in _spread(since))
        campaign = Campaign(f"since {since[0].name}", self.store.folder, self.machine, runs)
        return self._diagnose(campaign, self.judge.baseline, since[-WINDOW:], explained)

    def _read_again(self, cycle: Cycle) -> Run:
        file, place = Path(cycle.file), {"start_position_m": cycle.start_position_m, "start_time_s": cycle.start_s}
        return self._arrivals.read(Arrived(file, entry_of(file, cycle.name, payload_kg=cycle.payload_kg, **place)))

    def told(self, alarm: Alarm) -> Told:
        """An alarm in words, with what is known of its trend by now."""
        name, onset = self.judge.cycles[alarm.cycle].name, self.judge.cycles[alarm.onset].name
        goes = self.judge.trend_of(alarm, {key: get_value(self.machine, key) for key in watched_keys(self.machine)})
        cause, diagnosis = alarm.causes[0], self.store.said()[alarm.cycle].diagnosis
        unit = unit_of(cause.keys[0])
        amount = f"{cause.amount:+.3g} {unit} ({cause.name}, {100.0 * cause.share:.0f} % of the change)"
        amount += "" if goes is None else f", by now {goes.now:+.3g} {unit}"
        left = None if goes is None else goes.left
        until = f"; at this rate its limit is {left:.0f} cycles away" if left is not None else ""
        sentence = f"at {name}: the machine has left its identified self since {onset}: {amount}{until}."
        if diagnosis is not None:
            sentence += f" Diagnosis: {diagnosis['sentence']}"
        interval = None if goes is None else goes.left_ci95
        return Told(alarm.cycle, name, alarm.onset, sentence, alarm.causes, diagnosis, left, interval)

    def _post(self, told: Told) -> bool:
        import urllib.request

        data = json.dumps({"machine": self.machine.name, **asdict(told)}).encode()
        request = urllib.request.Request(str(self._hook), data, {"Content-Type": "application/json"})
        try:
            with urllib.request.urlopen(request, timeout=HOOK_S) as answer:
                return 200 <= int(answer.status) < 300
        except (OSError, ValueError) as error:
            self._once(f"{self._hook}: the alarm could not be posted: {error}; it is tried again")
            return False

    def _once(self, line: str) -> None:
        if line not in self._said_once:
            self._said_once.add(line)
            self._say(line)


def _spread(cycles: Sequence[Cycle]) -> list[Cycle]:
    """At most MOST_DIAGNOSED of them, the newest of each payload first: variety separates causes."""
    newest = {round(cycle.payload_kg / SAME_PAYLOAD_KG): k for k, cycle in enumerate(cycles)}
    chosen = sorted(range(len(cycles)), key=lambda k: (k not in newest.values(), -k))
    return [cycles[k] for k in sorted(chosen[:MOST_DIAGNOSED])]


def with_usual_limits(machine: Machine, rules: Rules) -> Rules:
    """Friction levels get a limit where the user names none. InputError for a limit of what is not estimated."""
    keys = watched_keys(machine)
    for key in rules.limits:
        if key not in keys:
            raise InputError(f"'{key}' is not estimated; {nearest(key, keys)}", place="limit")
    usual = {key: FRICTION_LIMIT * get_value(machine, key) for key in keys if "coulomb" in key}
    return replace(rules, limits={**usual, **rules.limits})


def patient(
    look: Callable[[], tuple[int, int]], every_s: float, stop: Callable[[], bool], *, once: bool, settle_s: float
) -> None:
    """Looks again and again until `stop`; once: until nothing is waited for, or nothing new has come for a while.
    look: how many cycles were new, and how many logs are waited for; less than 0: there is no use in waiting."""
    quiet_until = None
    while not stop():
        now = time.monotonic()
        new, waiting = look()
        if once:
            if waiting <= 0:
                break
            if new or quiet_until is None:
                quiet_until = now + 2.0 * settle_s + every_s
            if now >= quiet_until:
                break
        time.sleep(min(every_s, max(0.05, settle_s)) if once else every_s)
