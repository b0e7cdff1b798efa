"""Makes the first page quick: imports, kernels and the first study's runs while the browser still starts."""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from workbench.machine import Hoist
    from workbench.study.scenario import Scenario

SOON_S = 3.0  # until the first page, which needs the same processor, has been drawn
LATER_S = 7.0  # until a visitor looks at another page

_started = threading.Lock()
_threads: list[threading.Thread] = []


def warm() -> None:
    """Starts loading in the background, once in a process."""
    with _started:
        if not _threads:
            _threads.append(threading.Thread(target=_load, name="warm", daemon=True))
            _threads[0].start()


def started() -> bool:
    """Whether this process is a server that loads ahead."""
    return bool(_threads)


def wait() -> None:
    """Until all is loaded."""
    warm()
    _threads[0].join()


def whole_pandas() -> None:
    """Waits until pandas is whole, where some thread has begun to import it; before this thread makes a figure.

    Plotly looks for pandas in `sys.modules` and would use it half imported. No page needs it: it is not imported here,
    for that would be a third of the first page's imports.
    """
    if "pandas" in sys.modules:
        import pandas  # noqa: F401


def _load(soon_s: float = SOON_S, later_s: float = LATER_S) -> None:
    """The first page, what its sliders need, then the others. What fails here fails again, and is shown, where it is
    used."""
    for load, wait_s in ((_study, 0.0), (_sliders, soon_s), (_loop, later_s), (_others, 0.0)):
        time.sleep(wait_s)
        try:
            whole_pandas()
            load()
        except Exception:
            logging.getLogger(__name__).exception("loading ahead of time failed")


def _study() -> None:
    """The first page's imports; kernels and runs, in the page's order, or what an earlier start has kept of them. Who
    visits meanwhile waits for each but once."""
    from workbench.dashboard import first_study
    from workbench.dashboard.pages.compare import page as compare  # noqa: F401
    from workbench.dashboard.pages.study import page as study  # noqa: F401

    if first_study.is_kept():
        return
    scenario, machine = _first()
    values = {first_study.key(what, scenario, machine): run(scenario, machine) for what, run in _runs().items()}
    first_study.keep(values)


def _sliders() -> None:
    """Where the first study was kept, the kernels and the solver that it would have loaded, by one of another name."""
    from workbench.dashboard import first_study

    if not first_study.is_kept():
        return
    scenario, machine = _first()
    beside = scenario.model_copy(update={"name": "beside"})
    for run in _runs().values():
        run(beside, machine)


def _first() -> tuple[Scenario, Hoist]:
    from workbench.dashboard.pages.study.controls import Desk, scenario_of
    from workbench.machine import default_hoist

    machine = default_hoist()
    return scenario_of(Desk(), machine), machine


def _runs() -> dict[str, Callable[[Scenario, Hoist], Any]]:
    from workbench.dashboard.pages.study import runs

    return {
        runs.RUNS: runs.results,
        runs.PAYLOADS: runs.beside_payloads,
        runs.OTHER_RAMPS: runs.beside_ramps,
        runs.DAMPING: runs.on_damping,
    }


def _loop() -> None:
    """A loop of the default machine: its plant is linearised by kernels of their own."""
    from workbench.analysis.family import family, operating_points
    from workbench.dashboard.pages.loop import page as loop  # noqa: F401
    from workbench.figures.loop import steps
    from workbench.machine import default_hoist
    from workbench.reports.loop.case import usual_controller, usual_heights

    machine = default_hoist()
    points = operating_points(machine, (0.0,), usual_heights(machine)[:1], "hoisting")
    steps(family(machine, usual_controller(machine), points))


def _others() -> None:
    from workbench.dashboard.pages.batches import page as batches  # noqa: F401
    from workbench.dashboard.pages.gap import page as gap  # noqa: F401
    from workbench.dashboard.pages.machine import page as machine_view  # noqa: F401
    from workbench.dashboard.pages.plant import page as plant  # noqa: F401
    from workbench.dashboard.pages.signals import page as signals  # noqa: F401
    from workbench.dashboard.pages.validate import page as validate  # noqa: F401
