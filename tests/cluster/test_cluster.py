"""Studies on Dask: the same bytes, a killed worker costs nothing but time, and other programs are refused."""

from __future__ import annotations

import contextlib
import gc
import json
import multiprocessing
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.support.batches import ROOT, RUNS, SHORT, environment
from workbench.core.errors import InputError
from workbench.study import cluster
from workbench.study.cluster import OtherProgram, run_remote_chunk, spread_on, versions
from workbench.study.load import Study, load_study
from workbench.study.store import Progress, place_for, run_batch


@pytest.fixture(scope="module", autouse=True)
def distributed() -> None:
    """Imported here and not above: it takes a quarter of a second of every collection."""
    pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    path = tmp_path_factory.mktemp("cluster") / "batch.yaml"
    path.write_text(SHORT, encoding="utf-8")
    return load_study(path)


@pytest.fixture(scope="module")
def index(study: Study, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The batch run without a cluster."""
    out = tmp_path_factory.mktemp("local") / "out"
    run_batch(study, place_for(study, out))
    return (out / "index.parquet").read_bytes()


class Computers:
    """A scheduler and workers as real processes without a nanny: what dies stays dead."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.processes: list[subprocess.Popen[bytes]] = []
        self.scheduler = self._start("dask_scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", self.file)
        for _ in range(600):
            with contextlib.suppress(OSError, ValueError):
                self.address: str = json.loads(self.file.read_text())["address"]
                break
            time.sleep(0.05)
        self.workers = [
            self._start("dask_worker", self.address, "--no-nanny", "--nthreads", "1", "--no-dashboard")
            for _ in range(2)
        ]
        # Both are at work before anything is killed. Asked by a process of its own: in this one, after other tests, a
        # client's loop did not start in time.
        waiting = "import sys; from distributed import Client; Client(sys.argv[1]).wait_for_workers(2, timeout=60)"
        subprocess.run([sys.executable, "-c", waiting, self.address], check=True, timeout=120, env=environment())

    @property
    def file(self) -> Path:
        return self.folder / "scheduler.json"

    def _start(self, module: str, *words: object) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.{module}", *map(str, words), "--host", "127.0.0.1"]
        process = subprocess.Popen(
            command, cwd=self.folder, env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self.processes.append(process)
        return process

    def stop(self) -> None:
        for process in self.processes:
            process.kill()
        for process in self.processes:
            process.wait()


@pytest.fixture
def computers(tmp_path: Path) -> Iterator[Computers]:
    made = Computers(tmp_path)
    try:
        yield made
    finally:
        made.stop()


def killing_after(chunks: int, kill: Callable[[], object]) -> Callable[[Progress], None]:
    told: list[Progress] = []

    def tell(progress: Progress) -> None:
        told.append(progress)
        if len(told) == 1 + chunks:  # the first is told before any chunk
            kill()

    return tell


def test_a_worker_killed_in_the_middle_is_survived_by_the_rest_with_the_same_bytes(computers, study, index, tmp_path):
    out = tmp_path / "out"
    victim = computers.workers[0]
    with spread_on(computers.address) as spread:
        # Two more chunks are on the victim's hands at any time.
        run_batch(study, place_for(study, out), spread=spread, tell=killing_after(3, victim.kill))
    assert victim.wait(10) == -signal.SIGKILL
    assert (out / "index.parquet").read_bytes() == index


def listening() -> set[tuple[str, int]]:
    """Where this process and those it has started listen."""
    import psutil

    here = psutil.Process()
    of_all = [one for process in (here, *here.children(recursive=True)) for one in process.net_connections()]
    return {(one.laddr.ip, one.laddr.port) for one in of_all if one.status == "LISTEN"}


def test_processes_of_local_n_listen_on_loopback_only_do_the_same_and_one_that_is_killed_is_replaced(
    study: Study, index: bytes, tmp_path: Path
) -> None:
    from distributed import default_client

    out = tmp_path / "out"

    def kill_one() -> None:
        child = multiprocessing.active_children()[0]
        assert child.pid is not None
        os.kill(child.pid, signal.SIGKILL)

    with spread_on("local:2") as spread:
        assert len(multiprocessing.active_children()) == 2
        assert list(default_client().nthreads().values()) == [1, 1], "one thread each"
        addresses, ports = zip(*listening(), strict=True)
        assert len(ports) >= 3 and set(addresses) == {"127.0.0.1"}
        assert 8787 not in ports, "no dashboard"
        run_batch(study, place_for(study, out), spread=spread, tell=killing_after(2, kill_one))
    assert (out / "index.parquet").read_bytes() == index
    assert multiprocessing.active_children() == []


def test_a_scheduler_that_dies_is_an_error_that_says_so_and_keeps_what_is_done(
    computers: Computers, study: Study, index: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("workbench.study.cluster.CONNECT_S", 2)
    out = tmp_path / "out"
    place = place_for(study, out)
    with pytest.raises(InputError, match=r"tcp://127.*the cluster is gone"), spread_on(computers.address) as spread:
        run_batch(study, place, spread=spread, tell=killing_after(2, computers.stop))
    assert not out.exists()
    told: list[Progress] = []
    run_batch(study, place, tell=told.append)
    assert 256 <= told[0].kept < RUNS
    assert (out / "index.parquet").read_bytes() == index


def test_the_command_runs_on_a_cluster_and_signals_come_back_from_the_workers_too(tmp_path: Path) -> None:
    path = tmp_path / "signals.yaml"
    text = SHORT.replace("name: batch", "name: signals").replace(f"steps: {RUNS // 4}", "steps: 20")
    path.write_text(text.replace("none", "thinned"), encoding="utf-8")
    study = load_study(path)
    run_batch(study, place_for(study, tmp_path / "here"))
    words = ["study", str(path), "--out", str(tmp_path / "there"), "--cluster", "local:1"]
    done = subprocess.run(
        [sys.executable, "-m", "workbench", *words], cwd=ROOT, env=environment(), capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    here = [tmp_path / "here" / "index.parquet", *(tmp_path / "here").glob("runs/*/signals.parquet")]
    assert len(here) == 81
    for file in here:
        assert file.read_bytes() == (tmp_path / "there" / file.relative_to(tmp_path / "here")).read_bytes()


def test_a_worker_with_other_versions_is_refused(study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = pickle.dumps(study)
    other = run_remote_chunk(asked, 0, study.fingerprint, versions() | {"numpy": "1.0"})
    assert isinstance(other, OtherProgram) and "numpy" in other.what and "here 1.0" in other.what
    older = run_remote_chunk(asked, 0, "0123456789abcdef", versions())
    assert older == OtherProgram(older.where, "another version of workbench")  # type: ignore[union-attr]
    monkeypatch.setattr("workbench.study.cluster.versions", lambda: {"numpy": "1.0"})
    wanted = r"local:1: worker on .* has numpy .*, here 1\.0; the numbers would differ"
    with pytest.raises(InputError, match=wanted), spread_on("local:1") as spread:
        run_batch(study, place_for(study, tmp_path / "out"), spread=spread)


@pytest.mark.parametrize("text", ["local:0", "local", "tcp:/x", "8786", "local:2 "])
def test_a_text_that_names_no_cluster_is_refused(text: str) -> None:
    wanted = f"'{text}' is no cluster; expected tcp://host:port, or local:N"
    with pytest.raises(InputError, match=wanted), spread_on(text):
        raise AssertionError("went on")


def test_an_address_where_nobody_answers_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("workbench.study.cluster.CONNECT_S", 1)
    wanted = r"tcp://127\.0\.0\.1:1: no Dask scheduler answers there"
    with pytest.raises(InputError, match=wanted), spread_on("tcp://127.0.0.1:1"):
        raise AssertionError("went on")


@pytest.mark.parametrize(
    ("reply", "said"),
    [
        (b"", r"nobody there speaks as a Dask scheduler does, for 0\.5 s"),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n" * 3, "what answers there is no Dask scheduler"),
    ],
    ids=["silent", "http"],
)
def test_a_peer_that_is_no_scheduler_is_one_sentence_in_time(monkeypatch, reply, said):
    monkeypatch.setattr("workbench.study.cluster.CONNECT_S", 0.5)
    taken: list[socket.socket] = []

    def serve() -> None:
        with contextlib.suppress(OSError):
            while True:
                taken.append(server.accept()[0])
                taken[-1].sendall(reply)

    with socket.create_server(("127.0.0.1", 0)) as server:
        threading.Thread(target=serve, daemon=True).start()
        with pytest.raises(InputError, match=said), spread_on(f"tcp://127.0.0.1:{server.getsockname()[1]}"):
            pass
    for connection in taken:
        connection.close()


def test_a_client_that_was_given_up_is_collected_before_another_loop_starts():
    """Dask's loops start under a lock that a client takes when it is collected: a collection within a start waited for
    itself, and so did every later one. Such a client is in a cycle with its loop."""
    collected: list[int] = []

    class GivenUp:
        def __init__(self) -> None:
            self.itself = self

        def __del__(self) -> None:
            collected.append(1)

    gc.disable()
    try:
        GivenUp()
        assert not collected
        cluster._distributed()
        assert collected == [1]
    finally:
        gc.enable()


@pytest.mark.parametrize(
    ("address", "said"),
    [("tls://127.0.0.1:1", "needs certificates"), ("ucx://127.0.0.1:1", "Dask cannot speak ucx here")],
)
def test_a_way_of_speaking_that_is_not_set_up_is_one_sentence(address, said):
    with pytest.raises(InputError, match=said), spread_on(address):
        pass


def test_a_cluster_that_has_lost_its_last_worker_is_given_up_in_time(computers, study, tmp_path, monkeypatch):
    monkeypatch.setattr("workbench.study.cluster.WITHOUT_WORKERS_S", 2.0)

    def kill_both() -> None:
        for worker in computers.workers:
            worker.kill()

    wanted = pytest.raises(InputError, match=r"has had no worker for 2 s; what is done is kept")
    with wanted, spread_on(computers.address) as spread:
        run_batch(study, place_for(study, tmp_path / "out"), spread=spread, tell=killing_after(2, kill_both))


def test_a_result_that_dies_with_the_last_worker_before_it_is_fetched_is_not_waited_for(
    computers, study, tmp_path, monkeypatch
):
    monkeypatch.setattr("workbench.study.cluster.WITHOUT_WORKERS_S", 2.0)
    fetched = pytest.importorskip("distributed").Future.result

    def too_late(future: Any, timeout: float | None = None) -> Any:
        for worker in computers.workers:
            worker.kill()
            worker.wait()
        return fetched(future, timeout)

    monkeypatch.setattr("distributed.Future.result", too_late)
    wanted = pytest.raises(InputError, match=r"has had no worker for 2 s; what is done is kept")
    with wanted, spread_on(computers.address) as spread:
        run_batch(study, place_for(study, tmp_path / "out"), spread=spread)


def test_others_take_the_work_of_a_stopped_process(study, index, tmp_path, monkeypatch):
    """SIGSTOP, not SIGKILL: the connection stays open and nothing comes over it."""
    monkeypatch.setattr("workbench.study.cluster.SILENT_S", 4.0)
    stopped: list[int] = []

    def stop_one() -> None:
        stopped.append(multiprocessing.active_children()[0].pid or 0)
        os.kill(stopped[0], signal.SIGSTOP)

    with spread_on("local:2") as spread:
        run_batch(study, place_for(study, tmp_path / "out"), spread=spread, tell=killing_after(2, stop_one))
    assert stopped and (tmp_path / "out" / "index.parquet").read_bytes() == index
    assert multiprocessing.active_children() == [], "a stopped process is ended with the rest"


def test_a_process_that_dies_at_its_start_is_one_sentence(monkeypatch):
    def dies(**_: object) -> None:
        raise RuntimeError("Nanny failed to start.\nTraceback")

    monkeypatch.setattr("distributed.LocalCluster", dies)
    wanted = r"^local:2: its processes die at their start: Nanny failed to start\.[^\n]*$"
    with pytest.raises(InputError, match=wanted), spread_on("local:2"):
        pass
