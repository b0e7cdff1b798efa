"""Batches: killed, interrupted, resumed, doubled, half-broken; the result is the same to the byte, or none."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from click.testing import CliRunner

from tests.support.batches import RUNS, SCENARIO, SHORT, chunks_of, environment, part_of, wait_for_chunks, workbench
from workbench.cli.study import study as command
from workbench.core.errors import InputError
from workbench.study.load import Study, load_study
from workbench.study.store import LOCK, Chunk, Progress, on_this_computer, place_for, run_batch

SMALL = SHORT.replace(f"steps: {RUNS // 4}", "steps: 75").replace("name: batch", "name: three")


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("batch") / "batch.yaml"
    path.write_text(SCENARIO, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def index(file: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The batch run at once."""
    out = tmp_path_factory.mktemp("at_once") / "out"
    study = load_study(file)
    run_batch(study, place_for(study, out))
    return (out / "index.parquet").read_bytes()


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """300 runs in three chunks."""
    path = tmp_path_factory.mktemp("small") / "three.yaml"
    path.write_text(SMALL, encoding="utf-8")
    return load_study(path)


@pytest.fixture(scope="module")
def whole(small: Study, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The three chunks run at once."""
    out = tmp_path_factory.mktemp("whole") / "out"
    run_batch(small, place_for(small, out))
    return (out / "index.parquet").read_bytes()


def stopping_after(chunks: int, study: Study, numbers: Sequence[int]) -> Iterator[tuple[int, Chunk]]:
    """Runs some chunks, then is stopped as by Ctrl-C."""
    yield from on_this_computer(study, numbers[:chunks])
    raise KeyboardInterrupt


def never(study: Study, numbers: Sequence[int]) -> Iterator[tuple[int, Chunk]]:
    assert not numbers, "was run"
    return iter(())


def resumed(file: Path, out: Path, index: bytes, kept: int) -> None:
    """A second call goes on after what is kept and ends with the bytes of a batch run at once."""
    again = workbench("study", file, "--out", out)
    _, said = again.communicate(timeout=120)
    assert again.returncode == 0
    assert f"batch: goes on after {kept} of {RUNS} runs" in said
    assert (out / "index.parquet").read_bytes() == index
    assert part_of(out) is None
    assert json.loads((out / "manifest.json").read_text())["runs"] == {"all": RUNS, "ok": RUNS, "failed": 0}


def test_kill_9_in_the_middle_keeps_what_is_done_and_a_second_call_does_the_rest(
    file: Path, index: bytes, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    process = workbench("study", file, "--out", out)
    wait_for_chunks(out, 2, process)
    process.kill()
    process.communicate()
    assert not out.exists()
    assert 2 <= len(chunks_of(out)) < 10
    part = part_of(out)
    assert part and (part / LOCK).is_file(), "killed, it leaves its lock file"
    resumed(file, out, index, 128 * len(chunks_of(out)))


def test_while_one_process_runs_a_study_another_says_so_and_ctrl_c_says_what_is_kept(
    file: Path, index: bytes, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    process = workbench("study", file, "--out", out)
    wait_for_chunks(out, 2, process)
    process.send_signal(signal.SIGSTOP)
    try:
        second = workbench("study", file, "--out", out)
        _, said = second.communicate(timeout=60)
    finally:
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGCONT)
    assert second.returncode == 2
    assert f"is being written by process {process.pid} on " in said
    assert len(said.splitlines()) == 1
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    kept = 128 * len(chunks_of(out))
    assert f"batch: {kept} of {RUNS} runs done and kept; the same command goes on from there." in said
    assert "Traceback" not in said
    assert not out.exists()
    resumed(file, out, index, kept)


def test_a_batch_on_one_core_or_several_stopped_or_not_gives_the_same_bytes(
    small: Study, whole: bytes, tmp_path: Path
) -> None:
    for name, cores in (("one", 1), ("two", 2)):
        run_batch(small, place_for(small, tmp_path / name), spread=partial(on_this_computer, cores=cores))
    stopped = place_for(small, tmp_path / "stopped")
    for done in (1, 1):
        with pytest.raises(KeyboardInterrupt):
            run_batch(small, stopped, spread=partial(stopping_after, done))
        assert not stopped.folder.exists()
    run_batch(small, stopped)
    assert [path.read_bytes() for path in tmp_path.glob("*/index.parquet")] == 3 * [whole]


def test_a_kept_chunk_that_is_damaged_is_run_again(small: Study, whole: bytes, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        run_batch(small, place_for(small, out), spread=partial(stopping_after, 2))
    first, second = chunks_of(out)
    first.write_bytes(first.read_bytes()[:1000])
    second.write_bytes(b"")
    told: list[Progress] = []
    run_batch(small, place_for(small, out), tell=told.append)
    assert told[0].kept == 0
    assert (out / "index.parquet").read_bytes() == whole


def test_a_result_that_another_process_finished_meanwhile_is_left_alone(small: Study, tmp_path: Path) -> None:
    place = place_for(small, tmp_path / "out")  # found unfinished ...
    run_batch(small, place)
    before = (place.folder / "manifest.json").stat()
    run_batch(small, place, spread=never)
    assert (place.folder / "manifest.json").stat() == before
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_another_study_does_not_go_on_with_the_chunks_of_this_one(small: Study, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        run_batch(small, place_for(small, tmp_path / "out"), spread=partial(stopping_after, 1))
    other = replace(small, scenario=small.scenario.model_copy(update={"settle_s": 9.0}))
    told: list[Progress] = []
    with pytest.raises(KeyboardInterrupt):
        run_batch(other, place_for(other, tmp_path / "out"), spread=partial(stopping_after, 1), tell=told.append)
    assert told[0].kept == 0


PEAK = """
import resource, sys
from workbench.cli import main
try:
    main(["study", *sys.argv[1:]])
finally:
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def peak_mb(file: Path, out: Path) -> float:
    words = [sys.executable, "-c", PEAK, str(file), "--out", str(out)]
    done = subprocess.run(words, env=environment(), capture_output=True, text=True, check=True)
    return float(done.stdout.splitlines()[-1]) / 1024.0


def test_memory_is_the_same_for_ten_times_the_runs(tmp_path: Path) -> None:
    # The signals alone are 0.2 MB a run: 400 of them held in memory would show.
    taken = {}
    for runs in (40, 400):
        text = SCENARIO.replace(f"steps: {RUNS // 4}", f"steps: {runs // 4}").replace("none", "thinned, every_s: 0.02")
        path = tmp_path / f"{runs}.yaml"
        path.write_text(text, encoding="utf-8")
        taken[runs] = peak_mb(path, tmp_path / f"out{runs}")
    assert taken[400] < taken[40] + 60.0, taken


def test_several_files_go_into_folders_of_their_names(tmp_path: Path) -> None:
    files = []
    for name in ("one", "two"):
        files.append(tmp_path / f"{name}.yaml")
        text = SCENARIO.replace("name: batch", f"name: {name}").replace(f"steps: {RUNS // 4}", "steps: 2")
        files[-1].write_text(text, encoding="utf-8")
    done = CliRunner().invoke(command, [*map(str, files), "--out", str(tmp_path / "all")], catch_exceptions=False)
    assert done.exit_code == 0
    assert sorted(path.name for path in (tmp_path / "all").iterdir()) == ["one", "two"]
    twice = CliRunner().invoke(command, [str(files[0]), str(files[0]), "--out", str(tmp_path / "again")])
    assert isinstance(twice.exception, InputError)
    assert "is study 'one', like" in str(twice.exception)
    assert not (tmp_path / "again").exists()
