"""CPU of a fleet's cycle: `python -m benchmarks.fleet [--machines 100] [--kept 1000] [--rounds 2]`.

Each machine has a state of so many cycles already; in each round every machine gets one log, which is read, estimated,
judged, stored, copied to Parquet and drawn on its page. One cycle a minute on two cores leaves 1.2 s of CPU a cycle for
100 machines.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.attack.watch_states import HOIST, put, short_runs
from workbench.machines import get_value, save_machine
from workbench.view.watch import write_page
from workbench.watch.estimate import Estimate, watched_keys
from workbench.watch.fleet import Plan, run_fleet
from workbench.watch.judge import Cycle, Judge, Rules
from workbench.watch.store import Store

RULES = Rules()


def filled(folder: Path, kept: int) -> None:
    """A state of healthy cycles whose estimates scatter as those of short_runs."""
    noise, keys = np.random.default_rng(len(folder.name)), watched_keys(HOIST)
    sizes, nominal = np.array([300.0, 300.0, 100.0, 0.02, 10.0]), np.array([get_value(HOIST, key) for key in keys])
    store, judge = Store(folder, HOIST, RULES), Judge(RULES)
    for k in range(kept):
        made = Estimate(keys, nominal + sizes * noise.normal(size=5), sizes, np.eye(5), 1.0, 1.0)
        cycle = Cycle(f"c{k}", 4500.0, 60.0 * k, 20.0, made, f"{k:064x}", f"c{k}.csv", 9.0)
        store.add(k, cycle, judge.add(cycle))
    store.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=100)
    parser.add_argument("--kept", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=2)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        save_machine(HOIST, place / "machine.yaml")
        plans = []
        for i in range(given.machines):
            machine = f"m{i}"
            (place / "logs" / machine).mkdir(parents=True)
            filled(place / machine, given.kept)
            source, state = str(place / "logs" / machine), place / machine
            how = {"settle_s": 0.0, "page": write_page}
            plans.append(Plan(machine, source, place / "machine.yaml", state, RULES, how=how))
        rounds, spent = 0, [time.process_time()]

        def over() -> bool:
            """A new log each, after each look; the first look opens the states."""
            nonlocal rounds
            spent.append(time.process_time())
            for plan in plans:
                put(Path(plan.source), short_runs(given.rounds + 1)[rounds], 60.0 * (given.kept + rounds))
            rounds += 1
            spent.append(time.process_time())
            return rounds > given.rounds

        rows, _ = run_fleet(plans, None, place, 0.0, over, once=False, settle_s=0.0, say=lambda line: None)
        assert all(row.cycles == given.kept + given.rounds for row in rows), rows[0]
        looks = [after - before for before, after in zip(spent[2::2], spent[3::2], strict=False)]
        each = ", ".join(f"{look / given.machines:.3f}" for look in looks)
        print(f"{given.machines} machines with {given.kept} cycles each: CPU of a cycle, s, look by look: {each}")


if __name__ == "__main__":
    main()
