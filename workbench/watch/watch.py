"""The watch at work: what has arrived, estimate, judge, store, diagnose, tell."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from workbench.errors import InputError, nearest
from workbench.logs import Campaign
from workbench.logs.runs_file import Entry
from workbench.machine import Axis, Hoist, get_value
from workbench.names import unit_of
from workbench.run import Run
from workbench.watch.arrivals import Arrivals, Arrived
from workbench.watch.change import WINDOW, Baseline
from workbench.watch.estimate import estimate, watched_keys
from workbench.watch.judge import Cycle, Judge, Judged, Rules
from workbench.watch.store import Kept, KeptAlarm, Store, digest_of
from workbench.watch.stream.line import Line

Say = Callable[[str], None]
Diagnoser = Callable[[Campaign, Baseline, Sequence[Cycle]], Mapping[str, Any]]
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
    ) -> None:
        """line: what writes logs into the folder. diagnose: asked about each new alarm; None: nobody is. hook: address
        that each new alarm is posted to."""
        self.machine, self.rules = machine, with_usual_limits(machine, rules)
        self.store = Store(state, machine, rules)
        self._arrivals = Arrivals(folder, machine, settle_s)
        self._diagnose, self._hook, self._say, self._line = diagnose, hook, say, line
        self._said: set[str] = set()
        self.judge = Judge(self.rules)
        for kept in self.store.cycles():
            self.judge.add(kept.cycle)
        self.new_alarms = 0

    def close(self) -> None:
        self.store.close()

    def look(self, now: float) -> tuple[int, int]:
        """Takes what is complete; how many cycles were new, and how many logs are still waited for."""
        if self._line is not None:
            self._hear(self._line)
        try:
            complete, waiting = self._arrivals.look(now)
        except InputError as error:
            self._once(str(error))
            return 0, 1
        new = 0
        for arrived in complete:
            if arrived.entry is None:
                self._once(f"{arrived.file.name}: waits for its entry in runs.yaml or for {arrived.file.name}.yaml")
                waiting += 1
            else:
                new += self._take(arrived)
        if new:
            self.store.write_parquet()
        self._finish()
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
        self._arrivals.done(arrived.file)
        if self.store.known(digest):
            return 0
        try:
            run = self._arrivals.read(arrived)
            made = estimate(self.machine, run)
        except InputError as error:
            self.store.refuse(digest, arrived.file.name, str(error))
            self._say(f"not counted: {error}")
            return 0
        cycle = Cycle(run.name, run.payload_kg, run.start_time_s, run.duration_s, made)
        judged = self.judge.add(cycle)
        self.store.add(
            digest, str(arrived.file.resolve()), cycle, run.start_position_m, judged.counted, judged.statistic,
            judged.events, judged.alarm, judged.again, run.notes,
        )  # fmt: skip
        self._tell(cycle, judged)
        return 1

    def _tell(self, cycle: Cycle, judged: Judged) -> None:
        for event in judged.events:
            self._say(f"{cycle.name}: {event.text}")
        if judged.alarm is not None and not judged.again:
            self.new_alarms += 1
            self._say(f"ALARM {self.told(self.store.alarms()[-1]).sentence}")

    def _finish(self) -> None:
        """Alarms that nobody has diagnosed or told yet: of now, or of before a restart."""
        if self._diagnose is not None:
            for alarm, repeats in _with_repeats(self.store.alarms()):
                if _is_due(alarm, len(repeats)):
                    said = {**self._diagnosed(alarm, repeats), "repeats": len(repeats)}
                    self.store.diagnosed(alarm.cycle, said)
                    name = self.judge.cycles[alarm.cycle].name
                    self._say(f"diagnosis of the alarm at {name}: {said['sentence']}")
        if self._hook is not None:
            for alarm in self.store.alarms():
                if not alarm.told and not alarm.again and self._post(self.told(alarm)):
                    self.store.told(alarm.cycle)

    def _diagnosed(self, alarm: KeptAlarm, repeats: Sequence[KeptAlarm]) -> dict[str, Any]:
        """What the diagnosis says of the cycles since the onset; a sentence where it cannot be asked."""
        assert self._diagnose is not None and self.judge.baseline is not None
        runs: list[Run] = []
        last = max([alarm.cycle, *(repeat.cycle for repeat in repeats)])
        since = [kept for kept in self.store.cycles() if kept.counted and alarm.onset <= kept.number <= last]
        try:
            for kept in _spread(since):
                runs.append(self._again(kept))
            campaign = Campaign(f"since {since[0].cycle.name}", self.store.folder, self.machine, tuple(runs))
            return dict(self._diagnose(campaign, self.judge.baseline, [kept.cycle for kept in since[-WINDOW:]]))
        except InputError as error:
            return {"verdict": None, "effects": [], "sentence": f"not diagnosed: {error}"}

    def _again(self, kept: Kept) -> Run:
        file = Path(kept.file)
        entry = Entry(
            name=kept.cycle.name, file=file.name, payload_kg=kept.cycle.payload_kg,
            start_position_m=kept.start_position_m, start_time_s=kept.cycle.start_s,
        )  # fmt: skip
        return self._arrivals.read(Arrived(file, entry))

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


def run(
    watch: Watch, every_s: float, stop: Callable[[], bool], *, once: bool, settle_s: float, after: Callable[[], None]
) -> None:
    """Looks again and again until `stop`; once: until nothing is left to wait for, or nothing comes to rest. after: is
    called once at first, and whenever cycles were new."""
    quiet_until = None
    first = True
    while not stop():
        now = time.monotonic()
        new, waiting = watch.look(now)
        if new or first:
            after()
            first = False
        if once:
            if not waiting:
                return
            if new or quiet_until is None:
                quiet_until = now + 2.0 * settle_s + every_s
            if now >= quiet_until:
                return
        time.sleep(min(every_s, max(0.05, settle_s)) if once else every_s)
