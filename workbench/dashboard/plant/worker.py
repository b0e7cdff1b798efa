"""The process of a session's plant: `python -m workbench.dashboard.plant.worker`. It ends when its standard input does.

The first line in is what to serve or to attach to; then a line of JSON for every question, and one for its answer.
"""

from __future__ import annotations

import json
import sys
import threading
from collections import deque
from collections.abc import Mapping
from typing import Any

from pydantic import TypeAdapter

from workbench.control import PiSettings
from workbench.dashboard.plant.client import Client, Wanted
from workbench.dashboard.plant.line import Line, OwnLine, UdpLine
from workbench.dashboard.plant.recorder import Recorder
from workbench.effects import check
from workbench.errors import InputError
from workbench.kinds import studied
from workbench.machine import Hoist
from workbench.machine.files import machine_from
from workbench.references import Limits
from workbench.serve.serve import Wish, serve
from workbench.serve.session import Session
from workbench.yaml_strict import loads

SWITCH_S = 0.0005  # how long one thread may keep the others waiting
MOST_SAID = 50


class Desk:
    """The plant's line, its recorder and the built-in client, and what a page may ask of them."""

    def __init__(self, line: Line, machine: Hoist, said: deque[str]) -> None:
        self.line, self.machine, self.said = line, machine, said
        self.client: Client | None = None
        self.recorder = Recorder(line, self._beside)
        self.recorder.start()

    def _beside(self) -> Mapping[str, float]:
        client = self.client
        at_work = client is not None and client.at_work
        return {"speed_reference_rad_s": client.controller.reference_rad_s if client and at_work else float("nan")}

    def answer(self, question: Mapping[str, Any]) -> dict[str, Any]:
        """`order`: to the plant; `note`: words of it for the events; `client`: null ends it; `rows`: [generation,
        number]."""
        answer: dict[str, Any] = {}
        if "order" in question:
            answer["order"] = self.line.order(question["order"])
            if question.get("note"):
                self.recorder.note(str(question["note"]))
        if "client" in question:
            self._set_client(question["client"])
        if "rows" in question:
            generation, number = question["rows"]
            client = self.client
            answer |= self.recorder.since(int(generation), int(number))
            answer["status"] = self.line.order({"status": True})["status"]
            answer["client"] = {
                "at_work": client is not None and client.at_work,
                "ended": "" if client is None else client.ended,
            }
            answer["said"] = list(self.said)
        return answer

    def _set_client(self, given: Mapping[str, Any] | None) -> None:
        if self.client is not None:
            self.client.stop()
        self.client = None if given is None else Client(self.line, self.machine, wanted_of(given))


def wanted_of(given: Mapping[str, Any]) -> Wanted:
    """What the client does, from JSON: settings; heights_m, reference and limits where it moves."""
    settings = PiSettings.model_validate(given["settings"])
    if given.get("heights_m") is None:
        return Wanted(settings)
    low, high = given["heights_m"]
    return Wanted(settings, (float(low), float(high)), str(given["reference"]), Limits(*given["limits"]))


def wish_of(given: Mapping[str, Any]) -> Wish:
    """InputError for what cannot be."""
    wish = TypeAdapter(Wish).validate_python({**given, "ready": tuple(given.get("ready", ()))})
    wish.check()
    return wish


def main() -> int:
    sys.setswitchinterval(SWITCH_S)
    spec = json.loads(sys.stdin.readline())
    stop, said = threading.Event(), deque[str](maxlen=MOST_SAID)
    try:
        machine = machine_from(loads(spec["machine"], "machine.yaml"), check_effects=check)
        hoist = studied(machine)
        if "attach" in spec:
            assert hoist is not None
            line = UdpLine(int(spec["attach"]))
            status = line.order({"status": True, "points": True})
            _greet({"port": int(spec["attach"]), "name": status["status"]["machine"], "points": status["points"]})
            _answer_all(Desk(line, hoist, said), stop)
            return 0

        def ready(session: Session, port: int) -> None:
            assert hoist is not None
            points = [point.name for point in (*session.inputs, *session.outputs)]
            _greet({"port": port, "name": hoist.name, "points": points})
            desk = Desk(OwnLine(session), hoist, said)
            threading.Thread(target=_answer_all, args=(desk, stop), name="answers", daemon=True).start()

        serve(machine, wish_of(spec["wish"]), said.append, stop, ready=ready)
    except InputError as error:
        _greet({"error": {"problem": error.problem, "place": error.place}})
        return 2
    return 0


def _greet(words: Mapping[str, Any]) -> None:
    print(json.dumps(words), flush=True)


def _answer_all(desk: Desk, stop: threading.Event) -> None:
    """Until nobody asks any more."""
    try:
        for line in sys.stdin:
            try:
                answer = desk.answer(json.loads(line))
            except InputError as error:
                answer = {"error": {"problem": error.problem, "place": error.place}}
            _greet(answer)
    except OSError:
        pass  # the page's end has gone
    stop.set()


if __name__ == "__main__":
    sys.exit(main())
