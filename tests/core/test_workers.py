"""Workers: what they return and raise, that one may die alone, and that none outlives its parent."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from wakeflow.core.errors import ProgramError
from wakeflow.core.executor import Workers


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
