"""python -m benchmarks.campaigns --out DIR --count N --seed S [--kind …] [--machines …|axis] [--processes 2]"""

from __future__ import annotations

from pathlib import Path

import click

from benchmarks.campaigns.content import KINDS
from benchmarks.campaigns.families import MACHINES
from benchmarks.campaigns.many import make_all, orders


@click.command(help="Make campaigns of hoists, or of axes, whose truth is known; what is in DIR already stays.")
@click.option("--out", type=click.Path(path_type=Path, file_okay=False), required=True)
@click.option("--count", type=click.IntRange(min=1), required=True)
@click.option("--seed", type=int, required=True)
@click.option("--kind", type=click.Choice([*KINDS, "mixed"]), default="mixed", show_default=True)
@click.option("--machines", type=click.Choice(MACHINES), default="mixed", show_default=True)
@click.option("--processes", type=click.IntRange(1, 8), default=2, show_default=True)
def main(out: Path, count: int, seed: int, kind: str, machines: str, processes: int) -> None:
    make_all(orders(out, count, seed, kind, machines), processes)


if __name__ == "__main__":
    main()
