"""Nothing half-written passes for finished; no child outlives its parent; two threads at work end together."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from wakeflow.core.errors import FoamError, MeshError, ProgramError, SceneError
from wakeflow.core.files import atomic_write, write_json
from wakeflow.core.lazy import cached_property
from wakeflow.core.process import beside, call_in_child, heed, run_program, tail
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

    def test_clean_removes_what_is_unfinished(self, tmp_path: Path) -> None:
        store = Store(tmp_path)
        store.make("stage", "whole", lambda part: (part / "x").write_text("1"))
        (tmp_path / "stage" / "b.part").mkdir()
        assert store.clean()[0] == 1
        assert (tmp_path / "stage" / "whole").exists()
        assert store.clean(everything=True)[0] == 1


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
def test_children_die_with_their_parent(tmp_path: Path, number: int) -> None:
    code = (
        "import sys; from pathlib import Path; from wakeflow.core.process import run_program\n"
        f"here = Path({str(tmp_path)!r})\n"
        "run_program(['sh', '-c', 'echo $$ > pid; exec sleep 60'], cwd=here, log=here / 'log')"
    )
    parent = subprocess.Popen([sys.executable, "-c", code])
    pid_file = tmp_path / "pid"
    deadline = time.monotonic() + 20
    while not (pid_file.exists() and pid_file.read_text().strip()) and time.monotonic() < deadline:
        time.sleep(0.05)
    parent.send_signal(number)
    parent.wait()
    assert _gone(int(pid_file.read_text()))


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

    with beside([first, lambda: done.append("second")]):
        met.wait(LONG)
    assert done == ["first", "second"]


def test_without_jobs_only_the_block_runs() -> None:
    with beside([]):
        heed()


def test_a_job_that_fails_ends_the_program_that_the_block_waits_for(tmp_path: Path) -> None:
    def fail() -> None:
        time.sleep(0.2)
        raise FoamError("the other airflow diverged", ended="failed")

    begun = time.monotonic()
    with pytest.raises(FoamError, match="the other airflow diverged"), beside([fail]):
        sleeping(tmp_path)
    assert time.monotonic() - begun < LONG / 2
    heed()  # nothing is left of it in this thread


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
                heed()
            except Exception:
                pytest.fail("caught as if it were the block's")
            time.sleep(0.05)

    with pytest.raises(MeshError, match="folded"), beside([fail]):
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
    with pytest.raises(type(ending)), beside([job, lambda: later.append(1)]):
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
