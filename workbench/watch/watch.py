"""The watch at work: what has arrived, estimate, judge, store, diagnose, tell."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from workbench.core.errors import InputError, nearest
from workbench.core.names import unit_of
from workbench.core.run import Run
from workbench.logs import Campaign
from workbench.machines import Axis, Hoist, get_value
from workbench.watch.arrivals import Arrivals, Arrived, entry_of
from workbench.watch.change import WINDOW, Baseline
from workbench.watch.estimate import estimate, watched_keys
from workbench.watch.judge import Cycle, Judge, Judged, Rules
from workbench.watch.opcua import Line
from workbench.watch.store import (
    FILE,
    Copies,
    DamagedError,
    Kept,
    KeptAlarm,
    OldFormatError,
    Store,
    UnwritableError,
    digest_of,
    read_copies,
    read_old,
)

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
    causes: tuple[dict[str, Any], ...]
    diagnosis: dict[str, Any] | None
    cycles_left: float | None
    cycles_left_ci95: tuple[float, float] | None


class Watch:
    """One machine's logs and state. Built anew after a restart, it goes on where the store ends."""

    def __init__(
        self,
        folder: Path,
        machine: Hoist | Axis,
        state: Path,
        rules: Rules,
        *,
        settle_s: float = 2.0,
        line: Line | None = None,
        diagnose: Diagnoser | None = None,
        hook: str | None = None,
        say: Say = lambda line: None,
        wait_s: float = 0.0,
        page: Callable[[Watch], None] = lambda watch: None,
    ) -> None:
        """line: what writes logs into the folder. diagnose: asked about each new alarm; None: nobody is. hook: address
        that each new alarm is posted to. wait_s: how long another watch of this state is waited for. page: writes the
        page, whenever there is something new."""
        self.machine, self.rules = machine, with_usual_limits(machine, rules)
        self._arrivals = Arrivals(folder, machine, settle_s)
        try:
            self.store = Store(state, machine, rules, wait_s=wait_s, say=say)
        except OldFormatError as old:
            say(f"{old}; its cycles are judged anew")
            _renew(state, machine, rules, read_old(state, machine, rules))
            self.store = Store(state, machine, rules, wait_s=wait_s, say=say)
        self._diagnose, self._hook, self._say, self._line, self._page = diagnose, hook, say, line, page
        self._said: set[str] = set()
        self.judge = Judge(self.rules)
        self._pending: tuple[Kept, Judged] | None = None  # judged, and not yet written
        self.trouble: UnwritableError | None = None
        self.stale = True  # whether there is more in the store than in its copies
        try:
            for kept in self.store.cycles():
                self.judge.add(kept.cycle)
            if [alarm.cycle for alarm in self.store.alarms()] != [alarm.cycle for alarm in self.judge.alarms]:
                raise DamagedError(
                    "is damaged (its alarms are not those of its cycles); "
                    "'rebuild' makes it anew from cycles.parquet and the logs", file=state / FILE
                )  # fmt: skip
        except BaseException:
            self.store.close()
            raise

    def close(self) -> None:
        self.store.close()

    def look(self, now: float) -> tuple[int, int]:
        """Takes what is complete; how many cycles were new, and how many logs are still waited for.

        Where nothing can be written (`trouble`) it is tried again at the next look, and nothing is lost.
        """
        before = len(self.judge.cycles)
        try:
            _, waiting = self._look(now)
            self._finish()
            if self.stale:
                self.store.write_parquet()
                self._write_page()
                self.stale = False
        except UnwritableError as error:
            if self.trouble is None:
                self._say(f"{error}; it is tried again at each look")
            self.trouble, waiting = error, 1
        else:
            if self.trouble is not None:
                self._say(f"{self.store.folder}: there is room again; the watch goes on")
            self.trouble = None
        return len(self.judge.cycles) - before, waiting

    def _write_page(self) -> None:
        try:
            self._page(self)
        except OSError as error:
            reason = f"the page cannot be written: {error.strerror or error}"
            raise UnwritableError(reason, file=self.store.folder) from error

    def _look(self, now: float) -> tuple[int, int]:
        self._keep()
        if self._line is not None:
            self._hear(self._line)
        try:
            complete, waiting = self._arrivals.look(now)
        except InputError as error:
            self._once(str(error))
            return 0, 1
        new = 0
        for arrived in complete:
            if arrived.entry is None and not arrived.problem:
                self._once(f"{arrived.file.name}: waits for its entry in runs.yaml or for {arrived.file.name}.yaml")
                waiting += 1
            else:
                new += self._take(arrived)
        return new, waiting

    def _hear(self, line: Line) -> None:
        """What there is to say of a stream; a cycle that was spoilt is kept as one that does not count."""
        while not line.notes.empty():
            note = line.notes.get()
            if note.key:
                self.store.refuse(note.key, note.name, f"{note.name}: {note.text}")
                self._say(f"not counted: {note.name}: {note.text}")
            else:
                self._say(note.text)

    def _take(self, arrived: Arrived) -> int:
        """1 where the log is a new cycle."""
        try:
            digest = digest_of(arrived.file)
        except OSError as error:
            self._once(f"{arrived.file}: cannot be read: {error.strerror}")
            return 0
        except InputError as error:
            self._once(str(error))
            return 0
        aside = hashlib.sha256(f"{digest} {arrived.described}".encode()).hexdigest()
        if self.store.known(digest, aside):
            self._arrivals.done(arrived.file)
            return 0
        try:
            if arrived.entry is None:
                raise InputError(arrived.problem)
            run = self._arrivals.read(arrived)
            made = estimate(self.machine, run)
        except InputError as error:
            self.store.refuse(aside, arrived.file.name, str(error))
            self._arrivals.done(arrived.file)
            self._say(f"not counted: {error}")
            return 0
        number = len(self.judge.cycles)
        cycle = Cycle(run.name, run.payload_kg, run.start_time_s, run.duration_s, made)
        judged = self.judge.add(cycle)
        file, at = str(arrived.file.resolve()), run.start_position_m
        kept = Kept(number, digest, cycle, file, at, judged.counted, judged.statistic, run.notes)
        self._pending = kept, judged
        self._arrivals.done(arrived.file)
        self._keep()
        return 1

    def _keep(self) -> None:
        """Writes the cycle that was judged last, and tells of it. UnwritableError: it is still to be written."""
        if self._pending is None:
            return
        kept, judged = self._pending
        self.stale = True
        self.store.add(kept, judged)
        self._pending = None
        for event in judged.events:
            self._say(f"{kept.cycle.name}: {event.text}")
        if judged.alarm is not None and not judged.again:
            self._say(f"ALARM {self.told(self.store.alarms()[-1]).sentence}")

    def _finish(self) -> None:
        """Alarms that nobody has diagnosed or told yet: of now, or of before a restart."""
        if self._diagnose is not None:
            for alarm, repeats in _with_repeats(self.store.alarms()):
                if _is_due(alarm, len(repeats)):
                    said = {**self._diagnosed(alarm, repeats), "repeats": len(repeats)}
                    self.store.diagnosed(alarm.cycle, said)
                    self.stale = True
                    name = self.judge.cycles[alarm.cycle].name
                    self._say(f"diagnosis of the alarm at {name}: {said['sentence']}")
        if self._hook is not None:
            for alarm in self.store.alarms():
                if not alarm.told and not alarm.again and self._post(self.told(alarm)):
                    self.store.told(alarm.cycle)
                    self.stale = True

    def _diagnosed(self, alarm: KeptAlarm, repeats: Sequence[KeptAlarm]) -> dict[str, Any]:
        """The diagnosis of the cycles since the onset, beside what earlier alarms found; a sentence where it cannot be
        asked."""
        last = max([alarm.cycle, *(repeat.cycle for repeat in repeats)])
        try:
            return dict(self._asked(alarm.onset, last, self._explained(alarm)))
        except InputError as error:
            return {"verdict": None, "effects": [], "sentence": f"not diagnosed: {error}"}

    def _explained(self, alarm: KeptAlarm) -> Effects:
        """The effects of the alarms before this one, fitted anew to the cycles just before its onset: they may have
        gone on."""
        effects: Effects = {}
        earlier = [a for a, _ in _with_repeats(self.store.alarms()) if a.cycle < alarm.cycle]
        for one in earlier:
            if one.diagnosis is not None and one.diagnosis.get("verdict") == "named" and one.onset < alarm.onset:
                effects = {**effects, **one.diagnosis.get("fitted", {})}
                anew = self._asked(one.onset, alarm.onset - 1, {k: v for k, v in effects.items() if k not in
                                                               one.diagnosis["effects"]})  # fmt: skip
                effects = {**effects, **(anew.get("fitted", {}) if anew["effects"] == one.diagnosis["effects"] else {})}
        return effects

    def _asked(self, first: int, last: int, explained: Effects) -> Mapping[str, Any]:
        """The diagnosis of the cycles from `first` to `last`."""
        assert self._diagnose is not None and self.judge.baseline is not None
        since = [kept for kept in self.store.cycles() if kept.counted and first <= kept.number <= last]
        runs = tuple(self._again(kept) for kept in _spread(since))
        campaign = Campaign(f"since {since[0].cycle.name}", self.store.folder, self.machine, runs)
        return self._diagnose(campaign, self.judge.baseline, [kept.cycle for kept in since[-WINDOW:]], explained)

    def _again(self, kept: Kept) -> Run:
        file, cycle = Path(kept.file), kept.cycle
        said = {
            "payload_kg": cycle.payload_kg,
            "start_position_m": kept.start_position_m,
            "start_time_s": cycle.start_s,
        }
        return self._arrivals.read(Arrived(file, entry_of(file, cycle.name, **said)))

    def told(self, alarm: KeptAlarm) -> Told:
        """An alarm in words, with what is known of its trend by now."""
        name, onset = self.judge.cycles[alarm.cycle].name, self.judge.cycles[alarm.onset].name
        nominal = {key: get_value(self.machine, key) for key in watched_keys(self.machine)}
        raised = next(raised_alarm for raised_alarm in self.judge.alarms if raised_alarm.cycle == alarm.cycle)
        goes = self.judge.trend_of(raised, nominal)
        cause = alarm.causes[0]
        unit = unit_of(cause["keys"][0])
        amount = f"{cause['amount']:+.3g} {unit} ({cause['name']}, {100.0 * cause['share']:.0f} % of the change)"
        amount += "" if goes is None else f", by now {goes.now:+.3g} {unit}"
        left = None if goes is None else goes.left
        until = f"; at this rate its limit is {left:.0f} cycles away" if left is not None else ""
        sentence = f"at {name}: the machine has left its identified self since {onset}: {amount}{until}."
        if alarm.diagnosis is not None:
            sentence += f" Diagnosis: {alarm.diagnosis['sentence']}"
        return Told(
            alarm.cycle, name, alarm.onset, sentence, alarm.causes, alarm.diagnosis, left,
            None if goes is None else goes.left_ci95,
        )  # fmt: skip

    def _post(self, told: Told) -> bool:
        import urllib.request

        data = json.dumps({"machine": self.machine.name, **vars(told)}).encode()
        request = urllib.request.Request(str(self._hook), data, {"Content-Type": "application/json"})
        try:
            with urllib.request.urlopen(request, timeout=HOOK_S) as answer:
                return 200 <= int(answer.status) < 300
        except (OSError, ValueError) as error:
            self._once(f"{self._hook}: the alarm could not be posted: {error}; it is tried again")
            return False

    def _once(self, line: str) -> None:
        if line not in self._said:
            self._said.add(line)
            self._say(line)


def _with_repeats(alarms: Sequence[KeptAlarm]) -> list[tuple[KeptAlarm, list[KeptAlarm]]]:
    """Each alarm with those that followed for the same change."""
    grouped: list[tuple[KeptAlarm, list[KeptAlarm]]] = []
    for alarm in alarms:
        if alarm.again and grouped:
            grouped[-1][1].append(alarm)
        else:
            grouped.append((alarm, []))
    return grouped


def _is_due(alarm: KeptAlarm, repeats: int) -> bool:
    """A change is diagnosed when it alarms; where no cause was named, again after 1, 2, 4, ... repeats, when it may
    have grown."""
    if alarm.diagnosis is None:
        return True
    asked = int(alarm.diagnosis.get("repeats", 0))
    return alarm.diagnosis.get("verdict") != "named" and repeats >= max(1, 2 * asked) and repeats > asked


def _spread(kept: Sequence[Kept]) -> list[Kept]:
    """At most MOST_DIAGNOSED of them, the newest of each payload first: variety separates causes."""
    chosen: list[Kept] = []
    for stored in reversed(kept):
        if all(abs(stored.cycle.payload_kg - other.cycle.payload_kg) > 10.0 for other in chosen):
            chosen.append(stored)
    chosen += [stored for stored in reversed(kept) if stored not in chosen]
    return sorted(chosen[:MOST_DIAGNOSED], key=lambda stored: stored.number)


def with_usual_limits(machine: Hoist | Axis, rules: Rules) -> Rules:
    """Friction levels get a limit where the user names none. InputError for a limit of what is not estimated."""
    keys = watched_keys(machine)
    for key in rules.limits:
        if key not in keys:
            raise InputError(f"'{key}' is not estimated; {nearest(key, keys)}", place="limit")
    usual = {key: FRICTION_LIMIT * get_value(machine, key) for key in keys if "coulomb" in key}
    return replace(rules, limits={**usual, **rules.limits})


def rebuild(state: Path, machine: Hoist | Axis, rules: Rules) -> int:
    """Makes watch.sqlite anew from cycles.parquet; how many cycles it has. Logs that came later are read again."""
    copies = read_copies(state, machine, rules)
    _renew(state, machine, rules, copies)
    return len(copies.cycles)


def _renew(state: Path, machine: Hoist | Axis, rules: Rules, copies: Copies) -> None:
    """All cycles are judged again, in their order; what was said and told of an alarm is kept."""
    store, judge = Store(state, machine, rules, anew=True), Judge(rules)
    try:
        for kept in copies.cycles:
            judged = judge.add(kept.cycle)
            store.add(replace(kept, counted=judged.counted, statistic=judged.statistic), judged)
        for cycle, said in copies.alarms.items():
            store.say_again(cycle, *said)
        store.replace()
    finally:
        store.close()


def run(watch: Watch, every_s: float, stop: Callable[[], bool], *, once: bool, settle_s: float) -> None:
    """Looks again and again until `stop`; once: until nothing is left to wait for, or nothing comes to rest.
    UnwritableError where at the end something is still to be written."""
    quiet_until = None
    while not stop():
        now = time.monotonic()
        new, waiting = watch.look(now)
        if once:
            if not waiting or watch.trouble is not None:
                break
            if new or quiet_until is None:
                quiet_until = now + 2.0 * settle_s + every_s
            if now >= quiet_until:
                break
        time.sleep(min(every_s, max(0.05, settle_s)) if once else every_s)
    if watch.trouble is not None:
        raise watch.trouble
