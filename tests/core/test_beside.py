"""Two threads at work: each job is done, what fails first ends both, and no outside program is left behind."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from wakeflow.core.beside import beside, heed
from wakeflow.core.errors import FoamError, MeshError
from wakeflow.core.process import run_program

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
