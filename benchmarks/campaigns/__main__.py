"""python -m benchmarks.campaigns --out DIR --count N --seed S [--family …] [--case …] [--processes 2]"""

from __future__ import annotations

from pathlib import Path

import click

from benchmarks.campaigns.content import CASES
from benchmarks.campaigns.families import FAMILIES
from benchmarks.campaigns.many import make_all, orders


@click.command(help="Make campaigns of simulated machines whose truth is known; what is in DIR already stays.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True)
@click.option("--count", type=click.IntRange(min=1), required=True)
@click.option("--seed", type=int, required=True)
@click.option("--family", "families", type=click.Choice(list(FAMILIES)), multiple=True, help="Again for more than one.")
@click.option("--kind", type=click.Choice(["hoist", "axis"]), help="All families of this kind.")
@click.option("--case", type=click.Choice([*CASES, "mixed"]), default="mixed", show_default=True)
@click.option("--processes", type=click.IntRange(1, 8), default=2, show_default=True)
def main(out: Path, count: int, seed: int, families: tuple[str, ...], kind: str, case: str, processes: int) -> None:
    chosen = families or tuple(name for name, family in FAMILIES.items() if kind in (None, family.kind))
    counts = None if case == "mixed" else {case: count}
    make_all(orders(out, seed, chosen, count=count, counts=counts), processes)


if __name__ == "__main__":
    main()
