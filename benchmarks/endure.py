"""What must survive: `diagnose` and `blind run` killed many times, and the same bytes whatever the surroundings.

    python -m benchmarks.endure kills --times 20            # SIGKILL at random moments; then once whole; bytes compared
    python -m benchmarks.endure surroundings                # diagnose under other threads, cores, locale, hash seeds
    python -m benchmarks.endure rows --rows 10000000        # a log of so many rows, replayed

Each prints one line a promise and exits with 1 where one is broken. Linux.
"""

from __future__ import annotations

import hashlib
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import click
import numpy as np

ROOT = Path(__file__).resolve().parents[1]
DEMO = ROOT / "scenarios" / "demo_campaign"
TIMES = ("cpu_s", "wall_s")  # of a blind answer: what it took, not what it says
SURROUNDINGS: Mapping[str, Mapping[str, str]] = {
    "one thread": {"OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    "four threads": {"OPENBLAS_NUM_THREADS": "4", "NUMBA_NUM_THREADS": "4", "OMP_NUM_THREADS": "4"},
    "one core": {"core": "0"},
    "the other core": {"core": "1"},
    "a German locale": {"LC_ALL": "de_DE.UTF-8", "LANG": "de_DE.UTF-8"},
    "the C locale": {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0"},
    "hash seed 1": {"PYTHONHASHSEED": "1"},
    "another time zone": {"TZ": "Pacific/Chatham"},
    "no home": {"HOME": "/proc/nowhere", "XDG_CACHE_HOME": "/proc/nowhere"},
}


def workbench(words: Sequence[str | Path], more: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
    """The command in a session of its own, so that it can be killed with all that it has started."""
    surroundings = dict(more or {})
    core = surroundings.pop("core", None)
    before = ["taskset", "-c", core] if core else []
    command = [*before, sys.executable, "-m", "workbench", *map(str, words)]
    return subprocess.Popen(
        command, cwd=ROOT, env={**os.environ, **surroundings}, start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip


def finished(words: Sequence[str | Path], more: Mapping[str, str] | None = None) -> float:
    """Seconds that it took. ClickException where the command fails."""
    begun, process = time.monotonic(), workbench(words, more)
    _, said = process.communicate()
    if process.returncode:
        raise click.ClickException(f"{' '.join(map(str, words))}: {process.returncode}: {said.decode()[-300:]}")
    return time.monotonic() - begun


def killed(words: Sequence[str | Path], after_s: float) -> bool:
    """Whether it still ran when it was killed."""
    process = workbench(words)
    try:
        process.communicate(timeout=after_s)
        return False
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return True


def digests(folder: Path) -> dict[str, str]:
    files = sorted(file for file in folder.rglob("*") if file.is_file())
    return {str(f.relative_to(folder)): hashlib.sha256(f.read_bytes()).hexdigest() for f in files}


def same(a: Mapping[str, str], b: Mapping[str, str]) -> str:
    """ "" where all files are the same, else their names."""
    return ", ".join(sorted(name for name in {*a, *b} if a.get(name) != b.get(name)))


def answers_in(folder: Path) -> dict[str, str]:
    """The answers of a blind test without the time that they took."""
    read = {file.name: json.loads(file.read_text()) for file in sorted((folder / "answers").glob("*.json"))}
    kept = {name: {k: v for k, v in said.items() if k not in TIMES} for name, said in read.items()}
    return {name: json.dumps(said, sort_keys=True) for name, said in kept.items()}


def told(promise: str, broken: str) -> bool:
    click.echo(f"{promise}: {'BROKEN: ' + broken if broken else 'kept'}")
    return bool(broken)


@click.group()
def main() -> None:
    """Kill the long commands, change their surroundings, and compare what they write."""


@main.command()
@click.option("--times", type=click.IntRange(1), default=20, show_default=True, help="How often each is killed.")
@click.option("--seed", type=int, default=0, show_default=True, help="Of the moments.")
@click.option("--cases", type=click.IntRange(1), default=3, show_default=True, help="Campaigns of the blind test.")
def kills(times: int, seed: int, cases: int) -> None:
    """Kill diagnose and blind run at random moments; what they write in the end is what they write undisturbed."""
    chance, broken = random.Random(seed), False
    with tempfile.TemporaryDirectory(prefix="endure-") as temporary:
        place = Path(temporary)
        whole_s = finished(["diagnose", DEMO, "--out", place / "whole"])
        words: list[str | Path] = ["diagnose", DEMO, "--out", place / "killed"]
        struck = half = 0
        while struck < times:
            if killed(words, chance.uniform(0.0, 0.95 * whole_s)):
                struck += 1
                half += (place / "killed").exists()
            else:
                shutil.rmtree(place / "killed")  # done before its moment: not a kill
        finished(words)
        left = [file.name for file in place.iterdir() if file.name.startswith(".")]
        broken |= told(f"diagnose, killed {struck} times: nothing half-written", f"{half} times" if half else "")
        broken |= told("what killed writers left is swept", ", ".join(left))
        broken |= told("the same bytes", same(digests(place / "whole"), digests(place / "killed")))

        finished(["blind", "make", "--out", place / "test", "--cases", str(cases), "--seed", "5", "--source", "plant"])
        shutil.copytree(place / "test", place / "again")
        shutil.copy(place / "test.key", place / "again.key")
        each_s = finished(["blind", "run", place / "test", "--processes", "1"]) / cases
        struck, words = 0, ["blind", "run", place / "again", "--processes", "1"]
        while struck < times and killed(words, chance.uniform(0.0, 0.9 * each_s)):
            struck += 1
        finished(words)
        broken |= told(
            f"blind run, killed {struck} times", same(answers_in(place / "test"), answers_in(place / "again"))
        )
        score = finished(["blind", "score", place / "again"])
        broken |= told("and its chain of answers holds", "" if score else "?")
    sys.exit(broken)


@main.command()
@click.argument("campaign", type=click.Path(path_type=Path, exists=True), default=DEMO)
def surroundings(campaign: Path) -> None:
    """Diagnose the same campaign in other surroundings, and compare every byte."""
    broken = False
    with tempfile.TemporaryDirectory(prefix="endure ü ") as temporary:  # a path with a blank and a letter beyond ASCII
        place = Path(temporary)
        finished(["diagnose", campaign, "--out", place / "first"])
        first = digests(place / "first")
        for name, more in SURROUNDINGS.items():
            finished(["diagnose", campaign, "--out", place / name], more)
            broken |= told(f"the same bytes with {name}", same(first, digests(place / name)))
    sys.exit(broken)


@main.command()
@click.option("--rows", type=click.IntRange(1000), default=10_000_000, show_default=True)
def rows(rows: int) -> None:
    """Replay a campaign of one log with so many rows, CSV and Parquet."""
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    rng = np.random.default_rng(0)
    time_s = 0.001 * np.arange(rows)
    angle = 2.0 * np.pi * 0.2 * time_s
    speed, acceleration = 0.2 * np.sin(angle), 0.2 * 2.0 * np.pi * 0.2 * np.cos(angle)
    force = 100.0 * acceleration + 20.0 * np.tanh(speed / 0.001) + 200.0 * speed + rng.normal(0.0, 1.0, rows)
    table = pa.table({"time_s": time_s.round(3), "force_n": force.round(3), "velocity_m_s": speed.round(6)})
    friction = "{coulomb_forward_n: 20.0, coulomb_backward_n: 20.0, viscous_n_s_per_m: 200.0}"
    for ending, write in (("csv", pyarrow.csv.write_csv), ("parquet", pyarrow.parquet.write_table)):
        with tempfile.TemporaryDirectory(prefix="endure-") as temporary:
            folder = Path(temporary)
            write(table, folder / f"long.{ending}")
            text = f"kind: axis\nmotion: linear\nmass_kg: 100.0\nfriction: {friction}\n"
            (folder / "machine.yaml").write_text(text)
            (folder / "runs.yaml").write_text(f"runs: [{{name: long, file: long.{ending}}}]\n")
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            wall_s = finished(["replay", folder])
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            memory = f"largest process so far {after.ru_maxrss / 1e6:.2f} GB"
            click.echo(
                f"replay of {rows:,} rows of {ending}: {wall_s:.0f} s, {cpu_s:.0f} s of processor time, {memory}"
            )


if __name__ == "__main__":
    main()
