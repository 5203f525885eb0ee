"""Workers of this machine and of a cluster: they do what is asked, and end with whoever asked."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from support import LoopbackCluster
from wakeflow.core.errors import ProgramError, SceneError
from wakeflow.core.executor import Cluster, TaskPlace, Workers
from wakeflow.core.process import run_program
from wakeflow.core.store import Store


def test_workers_answer_raise_and_die_alone(tmp_path: Path) -> None:
    with Workers(1, tmp_path) as pool:
        first, failed = pool.submit(os.getpid), pool.submit(int, "seven")
        died, after = pool.submit(os.kill, 0, signal.SIGKILL), pool.submit(os.getpid)
        assert first.result() not in (os.getpid(), after.result())
        with pytest.raises(ProgramError, match=r"ValueError.*seven") as caught:
            failed.result()
        assert "Traceback" in caught.value.tail
        with pytest.raises(ProgramError, match="ended by signal 9"):
            died.result()
        pid = after.result()
    assert not _lives(pid)


def test_two_workers_work_at_once(tmp_path: Path) -> None:
    pool = Workers(2, tmp_path)
    slow = pool.submit(time.sleep, 300.0)
    assert pool.submit(os.getpid).result() != os.getpid()
    assert not slow.done()
    pool.end()


def test_an_exception_ends_workers_at_once(tmp_path: Path) -> None:
    started = time.monotonic()
    pool = Workers(1, tmp_path)
    pid = pool.submit(os.getpid).result()
    sleeping = pool.submit(time.sleep, 300.0)
    while not sleeping.running():
        time.sleep(0.01)
    with pytest.raises(KeyboardInterrupt), pool:
        raise KeyboardInterrupt
    assert time.monotonic() - started < 60.0
    assert not _lives(pid)
    with pytest.raises(ProgramError):
        sleeping.result()


def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    code = (
        "import os, time; from pathlib import Path; from wakeflow.core.executor import Workers\n"
        f"pool = Workers(1, Path({str(tmp_path)!r}))\n"
        "print(pool.submit(os.getpid).result(), flush=True); pool.submit(time.sleep, 300).result()"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        pid = int(parent.stdout.readline())
        assert _lives(pid)
        parent.kill()
    deadline = time.monotonic() + 30.0
    while _lives(pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not _lives(pid)


def _lives(pid: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False


SOLVER = ["sleep", "3333"]


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LoopbackCluster]:
    with LoopbackCluster(tmp_path_factory.mktemp("dask"), workers=2) as cluster:
        yield cluster


@pytest.fixture
def cluster(running: LoopbackCluster, tmp_path: Path) -> Iterator[Cluster]:
    with Cluster.connect(running.address, TaskPlace(tmp_path, tmp_path, tmp_path / "cache")) as found:
        yield found


def where() -> tuple[int, str, str]:
    return os.getpid(), str(Path.cwd()), os.environ["WAKEFLOW_CACHE"]


def solve(cache: Path) -> int:
    """A stage whose solver runs for ever, unless one has run there before; how many run there now."""

    def work(part: Path) -> None:
        others = _solvers(part)
        (part / "others").write_text(str(len(others)))
        if not (part / "log").exists():
            run_program(SOLVER, cwd=part, log=part / "log")

    folder, _ = Store(cache).make("airflow", "key", work)
    return int((folder / "others").read_text())


def _solvers(folder: Path) -> list[psutil.Process]:
    return [one for one in psutil.process_iter(["cmdline"]) if one.info["cmdline"] == SOLVER and _in(one, folder)]


def _in(process: psutil.Process, folder: Path) -> bool:
    try:
        return Path(process.cwd()) == folder
    except psutil.Error:  # it has ended meanwhile
        return False


def _runs(process: psutil.Process) -> bool:
    try:
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def _once(found: object, what: str) -> None:
    """Wait until ``found()`` holds."""
    assert callable(found)
    deadline = time.monotonic() + 120.0
    while not found():
        assert time.monotonic() < deadline, what
        time.sleep(0.05)


def test_tasks_have_processes_of_their_own_in_the_callers_place(cluster: Cluster, tmp_path: Path) -> None:
    assert cluster.size == 2
    assert [cluster.threads(tasks) for tasks in (1, 2, 3)] == [2, 1, 1]
    pid, cwd, cache = cluster.submit(where).result()
    assert pid not in {os.getpid(), *cluster.client.run(os.getpid).values()}
    assert (cwd, cache) == (str(tmp_path), str(tmp_path / "cache"))
    with pytest.raises(ProgramError, match=r"ValueError.*seven") as caught:
        cluster.submit(int, "seven").result()
    assert "Traceback" in caught.value.tail
    with pytest.raises(ProgramError, match="ended by signal 9"):
        cluster.submit(os.kill, 0, signal.SIGKILL).result()


def test_processes_end_with_their_executor(running: LoopbackCluster, tmp_path: Path) -> None:
    place = TaskPlace(tmp_path, tmp_path, tmp_path)
    with Cluster.connect(running.address, place) as first:
        pid = first.submit(os.getpid).result()
    assert not psutil.pid_exists(pid)
    second = Cluster.connect(running.address, place)
    second.submit(solve, tmp_path)
    _once(lambda: _solvers(tmp_path / "airflow" / "key.part"), "the solver starts")
    second.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    assert not _solvers(tmp_path / "airflow" / "key.part")


def test_a_worker_that_is_killed_leaves_no_solver_and_another_goes_on(cluster: Cluster, tmp_path: Path) -> None:
    part = tmp_path / "airflow" / "key.part"
    future = cluster.submit(solve, tmp_path)
    _once(lambda: _solvers(part), "the solver starts")
    (solver,) = _solvers(part)
    family = solver.parents()
    worker = next(one for one in family if one.pid in set(cluster.client.run(os.getpid).values()))
    worker.kill()
    assert future.result(timeout=120) == 0  # none ran beside the second
    assert not _runs(solver)
    _once(lambda: not any(map(_runs, family[: family.index(worker) + 1])), "what it had started ends")


def test_a_place_that_workers_do_not_see_is_said_so(running: LoopbackCluster, tmp_path: Path) -> None:
    with (
        Cluster.connect(running.address, TaskPlace(tmp_path, tmp_path / "nowhere", tmp_path)) as cluster,
        pytest.raises(ProgramError, match="file system that all workers share"),
    ):
        cluster.submit(os.getpid).result()


def test_mpi_jobs_go_to_workers_with_the_cores(cluster: Cluster, running: LoopbackCluster) -> None:
    with pytest.raises(SceneError, match=r"--resources ranks=4"):
        cluster.on(4)
    with running.worker("--resources", "ranks=4") as pid:
        assert cluster.on(4).submit(os.getppid).result(timeout=120) == pid
    assert cluster.on(1) is cluster


def test_a_scheduler_that_is_not_there_is_said_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("wakeflow.core.executor.PATIENCE", 0.5)
    with pytest.raises(SceneError, match=r"no Dask scheduler answers at 'tcp://127\.0\.0\.1:9'"):
        Cluster.connect("tcp://127.0.0.1:9", TaskPlace(tmp_path, tmp_path, tmp_path))
