"""How large batches scale: 10,000 full-metric runs of 49.8 s, here and on Dask, on one core and on two.

    python -m benchmarks.batch_scale [--runs 10000] [--rounds 2]

Payload, gain and jerk are swept, no signals are kept. Each way of running makes the whole result
folder; the ways take turns, and of each the best round counts, since other work on the computer only
ever takes time. The cluster's processes are started, and have run once, before the clock is. On a busy
computer the CPU time says more than the clock.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from workbench.study.cluster import spread_on
from workbench.study.load import Study, load_study
from workbench.study.store import Spread, chunk_sizes, on_this_computer, place_for, run_batch, run_chunk

SCENARIO = """\
format: 1
name: scale
payloads_kg: [0, 1000, 2000, 3000, 4000, 5000, 6000, 7000, 8000, 9000]
start_position_m: 4.0
moves: [{{by_m: 12.0}}, {{dwell_s: 5.0}}, {{by_m: -12.0}}]
limits: {{speed_m_s: 0.7, acceleration_m_s2: 0.6, jerk_m_s3: 0.8}}
references: [ruckig]
controller: {{kind: pi, kp_nm_s_per_rad: 31.0, ki_nm_per_rad: 122.0}}
lead_s: 2.0
settle_s: 4.64
outputs: {{signals: none}}
sweep:
  controller.kp_nm_s_per_rad: {{from: 10.0, to: 40.0, steps: 10}}
  limits.jerk_m_s3: {{from: 0.8, to: 4.0, steps: {jerks}}}
"""


@dataclass(frozen=True)
class Taken:
    """What a batch took: by the clock, and of the CPUs, all processes together."""

    clock_s: float
    cpu_s: float


def whole_batch(study: Study, spread: Spread, folder: Path) -> Taken:
    """A batch, to its finished folder."""
    begun, cpu = time.perf_counter(), cpu_s()
    run_batch(study, place_for(study, folder), spread=spread)
    return Taken(time.perf_counter() - begun, cpu_s() - cpu)


def cpu_s() -> float:
    """Of this process and of all that it has started, as they run."""
    import psutil

    here = psutil.Process()
    return sum(sum(process.cpu_times()[:2]) for process in (here, *here.children(recursive=True)))


def cost_of_a_run(study: Study) -> tuple[float, float]:
    """CPU time of a run on one core (ms), and of that what the kernel takes; the best of three chunks."""
    from workbench.engine.source import Kernel, KernelText

    finish, taken = KernelText.finish, [0.0]

    def timed(self: KernelText, name: str, arguments: Mapping[str, str]) -> Kernel:
        kernel = finish(self, name, arguments)

        def run(*given: object) -> int:
            begun = time.process_time()
            try:
                return kernel.run(*given)
            finally:
                taken[0] += time.process_time() - begun

        return replace(kernel, run=run)

    KernelText.finish = timed  # type: ignore[method-assign]
    try:
        run_chunk(study, 0)  # each kernel of this process is made here
    finally:
        KernelText.finish = finish  # type: ignore[method-assign]
    costs = []
    for _ in range(3):
        taken[0], begun = 0.0, time.process_time()
        run_chunk(study, 0)
        costs.append((1e3 * (time.process_time() - begun) / chunk_sizes(study)[0], taken[0]))
    whole, kernel = min(costs)
    return whole, 1e3 * kernel / chunk_sizes(study)[0]


@contextmanager
def all_ways(study: Study, folder: Path) -> Iterator[dict[str, Callable[[Path], Taken]]]:
    """name -> run the batch that way into a folder, and say what it took."""
    with spread_on("local:1") as one, spread_on("local:2") as two:
        ways: dict[str, Spread] = {
            "here, 1 core": partial(on_this_computer, cores=1),
            "here, 2 cores": partial(on_this_computer, cores=2),
            "cluster local:1": one,
            "cluster local:2": two,
        }
        for spread in ways.values():
            list(spread(study, [0, 1]))
        yield {name: partial(whole_batch, study, spread) for name, spread in ways.items()}


def over(value: float, base: float) -> str:
    return "" if value == base else f"{100.0 * (value / base - 1.0):+.1f} %"


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10_000, help="in hundreds")
    parser.add_argument("--rounds", type=int, default=2)
    said = parser.parse_args(words)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "scale.yaml").write_text(SCENARIO.format(jerks=max(2, said.runs // 100)), encoding="utf-8")
        study = load_study(folder / "scale.yaml")
        runs = len(study.specs)
        print(f"{runs} runs of {study.duration_s:.2f} s; load of the computer {os.getloadavg()[0]:.1f}", flush=True)
        whole, kernel = cost_of_a_run(study)
        print(f"a run on one core: {whole:.2f} ms CPU ({1e3 / whole:.0f} runs/s), the kernel {kernel:.2f} ms of it\n")
        best: dict[str, Taken] = {}
        indexes = set()
        with all_ways(study, folder) as ways:
            for turn in range(said.rounds):
                for name, run in ways.items():
                    out = folder / f"{name}-{turn}"
                    taken = run(out)
                    first = best.get(name, taken)
                    best[name] = Taken(min(first.clock_s, taken.clock_s), min(first.cpu_s, taken.cpu_s))
                    indexes.add((out / "index.parquet").read_bytes())
        print(f"{'':18}{'s':>8}{'runs/s':>8}{'over here':>11}{'CPU s':>8}{'over here':>11}")
        for name, taken in best.items():
            here = taken if name.startswith("here") else best["here, 2 cores" if name.endswith("2") else "here, 1 core"]
            clock, cpu = over(taken.clock_s, here.clock_s), over(taken.cpu_s, here.cpu_s)
            rate = f"{runs / taken.clock_s:8.0f}"
            print(f"{name:18}{taken.clock_s:8.2f}{rate}{clock:>11}{taken.cpu_s:8.2f}{cpu:>11}")
        print(f"\nbytes of index.parquet: {'all the same' if len(indexes) == 1 else 'DIFFERENT'}")
        if len(indexes) != 1:
            sys.exit(1)


if __name__ == "__main__":
    main()
