"""`python -m benchmarks.many_workers CAMPAIGNS`: diagnoses of many campaigns on one and on two local Dask workers.

Each number of workers is started anew; the time is from the first reading to the last answer, without the workers'
start. Beside the clock stands the share of it in which a worker was at work, which other programs hardly touch.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from workbench import __version__
from workbench.cli.diagnose import answered
from workbench.cli.measured import load_campaign
from workbench.study.cluster import client_on, each_on


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("campaigns", type=Path, nargs="+")
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args()
    clock = {}
    for workers in given.workers:
        clock[workers] = measured(given.campaigns, workers, given.quick)
        print(f"{workers} workers: {clock[workers]:.1f} s, {clock[given.workers[0]] / clock[workers]:.2f} times one")


def measured(folders: list[Path], workers: int, quick: bool) -> float:
    """The seconds of all campaigns. A first, unmeasured one compiles in every worker."""
    from distributed import get_task_stream

    where, options = f"local:{workers}", {"quick": quick, "study": False}
    with client_on(where) as client:
        client.wait_for_workers(workers)
        first = load_campaign(folders[0])
        for future in [
            client.submit(answered, at, first, __version__, options, False, (), workers=[at])
            for at in client.nthreads()
        ]:
            future.result()
        begun = time.monotonic()
        with get_task_stream(client) as stream:
            read = {str(folder): load_campaign(folder) for folder in folders}
            asked = (__version__, options, False, ())
            rows = list(each_on(client, where, list(read), lambda name: (answered, name, read[name], *asked)))
        lasted = time.monotonic() - begun
        busy = sum(step["stop"] - step["start"] for task in stream.data for step in task["startstops"]
                   if step["action"] == "compute")  # fmt: skip
        troubles = [row.trouble for _, row in rows if row.trouble]
        print(f"  {len(rows)} campaigns, {len(troubles)} troubles; at work {100.0 * busy / (workers * lasted):.0f} %")
    return lasted


if __name__ == "__main__":
    main()
