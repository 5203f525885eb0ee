"""Nothing half-written passes for finished; children and workers do what is asked and end with their parent."""

import ast
import gc
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import psutil
import pytest

from support import LoopbackCluster, begun_part
from wakeflow.core.code_key import PACKAGE
from wakeflow.core.errors import FoamError, MeshError, ProgramError, SceneError
from wakeflow.core.executor import Cluster, TaskPlace, Workers
from wakeflow.core.files import atomic_write, write_json
from wakeflow.core.lazy import cached_property, parsed
from wakeflow.core.process import background, call_in_child, check_cancelled, run_program, start_in_group, tail
from wakeflow.core.store import Store, content_key


def test_a_failed_write_leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")

    def fail() -> None:
        with atomic_write(target) as stream:
            stream.write("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_json_refuses_nan(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        write_json(tmp_path / "a.json", {"x": float("nan")})
    assert not list(tmp_path.iterdir())


def test_key_ignores_order_and_sees_every_value() -> None:
    assert content_key({"a": 1, "b": 2.0}) == content_key({"b": 2.0, "a": 1})
    assert content_key({"a": 1}) != content_key({"a": 2})


class TestStore:
    def test_makes_once_then_finds(self, tmp_path: Path) -> None:
        store, calls = Store(tmp_path), []

        def work(folder: Path) -> None:
            calls.append(folder)
            (folder / "x").write_text("1")

        first, cached = store.make("stage", "key", work)
        again, cached_again = store.make("stage", "key", work)
        assert (cached, cached_again, first, len(calls)) == (False, True, again, 1)

    def test_a_killed_stage_is_not_taken_for_finished_and_finds_its_files(self, tmp_path: Path) -> None:
        store = Store(tmp_path)

        def dies(folder: Path) -> None:
            (folder / "half").write_text("1")
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            store.make("stage", "key", dies)
        assert not (tmp_path / "stage" / "key").exists()
        seen = []
        store.make("stage", "key", lambda folder: seen.append((folder / "half").read_text()))
        assert seen == ["1"]

    def test_a_damaged_stage_is_made_again(self, tmp_path: Path) -> None:
        store = Store(tmp_path)
        folder, _ = store.make("stage", "key", lambda part: (part / "x").write_text("good"))
        (folder / "x").write_text("bad!")
        folder, cached = store.make("stage", "key", lambda part: (part / "x").write_text("good"))
        assert not cached
        assert (folder / "x").read_text() == "good"


def test_lines_arrive_and_the_log_is_whole(tmp_path: Path) -> None:
    lines: list[str] = []
    command = [sys.executable, "-c", "for i in range(3): print('line', i)"]
    done = run_program(command, cwd=tmp_path, log=tmp_path / "log", on_line=lines.append)
    assert lines == ["line 0", "line 1", "line 2"]
    assert done.returncode == 0
    assert tail(tmp_path / "log", 1) == "line 2"


def test_failure_carries_command_log_and_last_lines(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "print('before'); raise SystemExit(4)"]
    with pytest.raises(MeshError, match="exit code 4") as caught:
        run_program(command, cwd=tmp_path, log=tmp_path / "log", error=MeshError)
    assert caught.value.tail == "before"
    assert caught.value.log == tmp_path / "log"
    assert sys.executable in caught.value.command


def test_missing_program_is_named_with_the_cure(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match=r"'no-such-program' is not installed; sh cases/setup\.sh"):
        run_program(["no-such-program"], cwd=tmp_path, log=tmp_path / "log", hint="sh cases/setup.sh")


def test_timeout_ends_the_whole_group(tmp_path: Path) -> None:
    script = f"sleep 60 & echo $! > {tmp_path}/pid; wait"
    with pytest.raises(ProgramError, match="did not end within"):
        run_program(["sh", "-c", script], cwd=tmp_path, log=tmp_path / "log", timeout=0.5)
    assert _gone(int((tmp_path / "pid").read_text()))


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
@pytest.mark.parametrize("deaf", ["", 'trap "" TERM INT; '])
def test_children_die_with_their_parent(tmp_path: Path, number: int, deaf: str) -> None:
    code = (
        "import sys; from pathlib import Path; from wakeflow.core.process import run_program\n"
        f"here = Path({str(tmp_path)!r})\n"
        f"run_program(['sh', '-c', {f'{deaf}echo $$ > pid; exec sleep 60'!r}], cwd=here, log=here / 'log')"
    )
    parent = subprocess.Popen([sys.executable, "-c", code])
    pid_file = tmp_path / "pid"
    deadline = time.monotonic() + 20
    while not (pid_file.exists() and pid_file.read_text().strip()) and time.monotonic() < deadline:
        time.sleep(0.05)
    parent.send_signal(number)
    parent.wait()
    assert _gone(int(pid_file.read_text()))


def test_a_killed_runs_program_is_waited_for_before_its_folder_is_worked_in(tmp_path: Path) -> None:
    """On a busy machine it writes on for a moment after the run that started it is gone."""
    store, seen = Store(tmp_path), []
    part = begun_part(tmp_path, "stage", "a" * 64)
    with (tmp_path / "log").open("wb") as sink:
        child = start_in_group(["sh", "-c", "sleep 1; echo late > late"], part, os.environ, sink)
    threading.Thread(target=child.wait, daemon=True).start()
    store.make("stage", "a" * 64, lambda folder: seen.append((folder / "late").read_text()))
    assert seen == ["late\n"]


def _gone(pid: int) -> bool:
    for _ in range(100):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        if Path(f"/proc/{pid}/stat").read_text().split()[2] == "Z":  # dead, nobody has asked for its exit code yet
            return True
        time.sleep(0.05)
    return False


def test_calls_in_a_child_return_raise_and_crash_cleanly(tmp_path: Path) -> None:
    log = tmp_path / "log"
    assert call_in_child("math:sqrt", 9.0, log=log) == 3.0
    with pytest.raises(SceneError, match="no scene file"):
        call_in_child("wakeflow.scene.scene:Scene.load", "none", log=log)
    with pytest.raises(ProgramError, match="exit code") as caught:
        call_in_child("os:abort_now", 1, log=log)
    assert "AttributeError" in caught.value.tail
    with pytest.raises(ProgramError, match="exit code"):
        call_in_child("os:_exit", 139, log=log)


LONG = 60.0  # s that nobody waits


def sleeping(folder: Path, seconds: float = LONG) -> None:
    """An outside program that takes its time."""
    run_program(["sleep", str(seconds)], cwd=folder, log=folder / f"log.{threading.get_ident()}")


def test_jobs_are_done_in_their_order_beside_the_block() -> None:
    done: list[str] = []
    met = threading.Barrier(2)

    def first() -> None:
        met.wait(LONG)  # the block is there at the same time
        done.append("first")

    with background([first, lambda: done.append("second")]):
        met.wait(LONG)
    assert done == ["first", "second"]


def test_without_jobs_only_the_block_runs() -> None:
    with background([]):
        check_cancelled()


def test_a_job_that_fails_ends_the_program_that_the_block_waits_for(tmp_path: Path) -> None:
    def fail() -> None:
        time.sleep(0.2)
        raise FoamError("the other airflow diverged", ended="failed")

    begun = time.monotonic()
    with pytest.raises(FoamError, match="the other airflow diverged"), background([fail]):
        sleeping(tmp_path)
    assert time.monotonic() - begun < LONG / 2
    check_cancelled()  # nothing is left of it in this thread


def test_a_failure_of_a_job_is_never_taken_for_one_of_the_block() -> None:
    """The ladder of safer settings catches failures of its own solver: it must not catch the other thread's."""
    failed = threading.Event()

    def fail() -> None:
        failed.set()
        raise MeshError("folded")

    def heeding_in_spite_of_failures() -> None:
        assert failed.wait(LONG)
        for _ in range(100):
            try:
                check_cancelled()
            except Exception:
                pytest.fail("caught as if it were the block's")
            time.sleep(0.05)

    with pytest.raises(MeshError, match="folded"), background([fail]):
        heeding_in_spite_of_failures()


@pytest.mark.parametrize("ending", [KeyboardInterrupt(), MeshError("folded")])
def test_a_block_that_ends_takes_the_jobs_program_with_it(tmp_path: Path, ending: BaseException) -> None:
    started, later = threading.Event(), []

    def job() -> None:
        started.set()
        sleeping(tmp_path)

    def end() -> None:
        assert started.wait(LONG)
        raise ending

    begun = time.monotonic()
    with pytest.raises(type(ending)), background([job, lambda: later.append(1)]):
        end()
    assert time.monotonic() - begun < LONG / 2
    assert not later


class Slow:
    def __init__(self, meeting: Barrier) -> None:
        self.meeting, self.times = meeting, 0

    @cached_property
    def made(self) -> int:
        """What it says."""
        self.times += 1
        self.meeting.wait(timeout=20)
        return self.times


def test_two_threads_do_not_wait_for_each_other_and_each_value_is_made_once() -> None:
    both = Barrier(2)  # broken, and an error, where one is made only after the other
    subjects = [Slow(both), Slow(both)]
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(lambda one: one.made, subjects)) == [1, 1]
    assert [one.made for one in subjects] == [1, 1]
    assert Slow.made.__doc__ == "What it says."


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


def test_threads_may_read_sources_at_once() -> None:
    """CPython issue 106905: where a collection of garbage lets another thread parse, both ended in a SystemError."""
    files = sorted(PACKAGE.glob("**/*.py"))[:60]
    found: list[str] = []

    def read() -> None:
        try:
            found.extend(ast.dump(parsed(file))[:20] for file in files)
        except SystemError as problem:
            found.append(str(problem))

    def switch(*_: object) -> None:
        time.sleep(1e-6)

    usual = gc.get_threshold()
    gc.callbacks.append(switch)
    gc.set_threshold(50)
    try:
        threads = [threading.Thread(target=read) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        gc.set_threshold(*usual)
        gc.callbacks.remove(switch)
    assert found == ["Module(body=[Expr(va"] * 3 * len(files)


def test_a_source_is_parsed_again_where_a_library_parses_meanwhile(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It takes no turn, and CPython 3.11.2 ends in a SystemError."""
    file, tries = tmp_path / "one.py", iter([SystemError("AST constructor recursion depth mismatch")] * 3)
    file.write_text("a = 1\n")
    parse = ast.parse

    def disturbed(source: bytes) -> ast.Module:
        for problem in tries:
            raise problem
        return parse(source)

    monkeypatch.setattr(ast, "parse", disturbed)
    assert ast.dump(parsed(file)) == ast.dump(parse("a = 1\n"))
