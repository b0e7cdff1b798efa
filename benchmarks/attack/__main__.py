"""`python -m benchmarks.attack --inputs 10000 --seed 0`: attack the readers, and print what came of it as a table."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import click

from benchmarks.attack.mangle import KINDS, ROOT
from benchmarks.attack.victim import Ended

SLOW_S, LARGE_MB = 10.0, 500.0
GIVE_UP_S = 300.0  # by the clock
BAD = ("traceback", "unsound", "unclear", "silent", "crash", "hang")


@dataclass(frozen=True)
class Result:
    kind: str
    seed: int
    ended: Ended

    @property
    def bad(self) -> bool:
        return self.ended.how in BAD or self.ended.seconds > SLOW_S or self.ended.memory_mb > LARGE_MB


def attack(
    kinds: Sequence[str],
    seeds: Sequence[int],
    command: Sequence[str] = (),
    tell: Callable[[Result], None] = lambda _: None,
    done: Sequence[Result] = (),
) -> list[Result]:
    """Reads all inputs in a process that is replaced when it dies or hangs, which counts. `tell` hears of each.

    done: what an earlier call has read already; it is in the answer and is not read again.
    """
    words = list(command) or [sys.executable, "-m", "benchmarks.attack.victim"]
    known = {(result.kind, result.seed): result for result in done}
    whole = [(kind, seed) for seed in seeds for kind in kinds]
    inputs = [one for one in whole if one not in known]
    results: list[Result] = []
    with tempfile.TemporaryFile("w+") as last_words:
        while len(results) < len(inputs):
            victim = subprocess.Popen(
                words, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=last_words, text=True
            )
            try:
                for result in _fed(victim, inputs[len(results) :]):
                    results.append(result)
                    tell(result)
            finally:
                _ended(victim)
    return [*(known[one] for one in whole if one in known), *results]


def _ended(victim: subprocess.Popen[str]) -> None:
    """The end of its input lets it take its own files away."""
    assert victim.stdin is not None and victim.stdout is not None
    with contextlib.suppress(BrokenPipeError):
        victim.stdin.close()
    try:
        victim.wait(5.0)
    except subprocess.TimeoutExpired:
        victim.kill()
        victim.wait()
    victim.stdout.close()


def _fed(victim: subprocess.Popen[str], inputs: Sequence[tuple[str, int]]) -> Iterator[Result]:
    """Inputs one by one until the victim is gone."""
    assert victim.stdin is not None and victim.stdout is not None
    for kind, seed in inputs:
        begun = time.perf_counter()
        watch = threading.Timer(GIVE_UP_S, victim.kill)
        watch.start()
        try:
            victim.stdin.write(f"{kind} {seed}\n")
            victim.stdin.flush()
            line = victim.stdout.readline()
        except BrokenPipeError:
            line = ""
        watch.cancel()
        if not line:
            seconds = time.perf_counter() - begun
            how = "hang" if seconds >= GIVE_UP_S else "crash"
            yield Result(kind, seed, Ended(how, f"exit status {victim.wait()}", seconds))
            return
        yield Result(kind, seed, Ended(**json.loads(line)))


def table(results: Sequence[Result]) -> str:
    """What came of each kind of input, as a table of Markdown."""
    head = [
        "input", "number", "refused", "read, noted", "read", *BAD, f"over {SLOW_S:g} s", f"over {LARGE_MB:g} MB",
        "most processor time, s", "most memory, MB",
    ]  # fmt: skip
    lines = [head]
    for kind in [*dict.fromkeys(result.kind for result in results), "all"]:
        ended = [result.ended for result in results if kind in (result.kind, "all")]
        how = Counter(outcome.how for outcome in ended)
        slow, large = [e.seconds for e in ended], [e.memory_mb for e in ended]
        lines.append([
            kind, str(len(ended)), *(str(how[name]) for name in ("refused", "noted", "read", *BAD)),
            str(sum(s > SLOW_S for s in slow)), str(sum(m > LARGE_MB for m in large)),
            f"{max(slow):.2f}", f"{max(large):.0f}",
        ])  # fmt: skip
    lines.insert(1, ["---"] * len(lines[0]))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _read(file: Path) -> list[Result]:
    """What an earlier run wrote; a line that it did not finish is left out."""
    results = []
    for line in file.read_text(encoding="utf-8").splitlines():
        with contextlib.suppress(ValueError, KeyError, TypeError):
            said = json.loads(line)
            results.append(Result(said.pop("kind"), said.pop("seed"), Ended(**said)))
    return results


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.option("--inputs", type=click.IntRange(1), default=10_000, show_default=True, help="How many.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="The same seed, the same inputs.")
@click.option("--kinds", default=",".join(KINDS), show_default=True, help="What is mangled, with commas between.")
@click.option("--out", type=click.Path(path_type=Path), help="A file for one line of JSON an input; what is in it "
              "is not read again, so that a run that was stopped goes on.")  # fmt: skip
@click.option("--with", "others", type=click.Path(path_type=Path, exists=True), multiple=True,
              help="Such a file of another run, whose inputs count in the table.")  # fmt: skip
def main(inputs: int, seed: int, kinds: str, out: Path | None, others: tuple[Path, ...]) -> None:
    """Read mangled inputs, count what breaks, and print a table. Exit status 1 when anything did."""
    chosen = [kind for kind in kinds.split(",") if kind]
    if unknown := [kind for kind in chosen if kind not in KINDS]:
        raise click.BadParameter(f"{unknown[0]!r}; expected {', '.join(KINDS)}", param_hint="--kinds")
    first = seed * 1_000_000
    done = _read(out) if out is not None and out.exists() else []
    with contextlib.ExitStack() as stack:
        log = None if out is None else stack.enter_context(out.open("a", encoding="utf-8"))

        def tell(result: Result) -> None:
            ended = result.ended
            if log is not None:
                log.write(json.dumps({"kind": result.kind, "seed": result.seed, **vars(ended)}) + "\n")
                log.flush()
            if result.bad:
                cost = f"{ended.seconds:.1f} s, {ended.memory_mb:.0f} MB"
                click.echo(f"{result.kind} {result.seed}: {ended.how}, {cost}: {ended.said[:300]!r}")

        results = attack(chosen, range(first, first + -(-inputs // len(chosen))), tell=tell, done=done)
    results += [result for other in others for result in _read(other)]
    click.echo(table(results))
    sys.exit(any(result.bad for result in results))


if __name__ == "__main__":
    main()
