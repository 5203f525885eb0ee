"""Work in a second thread beside the caller's own, on a core that would be idle; what fails first ends both."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator, Sequence

__all__ = ["beside", "heed"]

_thread = threading.local()


class _Over(BaseException):
    """The other thread has failed. No Exception: nobody may take it for a failure of the program that it ends."""


def heed() -> None:
    """End this thread's work where the other's has failed; called several times a second by what takes long."""
    over: threading.Event | None = getattr(_thread, "over", None)
    if over is not None and over.is_set():
        raise _Over


@contextlib.contextmanager
def beside(jobs: Sequence[Callable[[], object]]) -> Iterator[None]:
    """Do ``jobs`` one after the other in a thread of their own while the block of the ``with`` runs; wait for both.

    Where a job raises, the block is ended at its next :func:`heed`, outside programs at once, and the job's exception
    is raised; where the block raises, Ctrl-C included, the job is ended likewise.
    """
    failed: list[BaseException] = []
    job_failed, block_failed = threading.Event(), threading.Event()

    def work() -> None:
        try:
            with _ends_with(block_failed):
                for job in jobs:
                    heed()
                    job()
        except _Over:
            pass
        except BaseException as problem:  # raised again by the caller's thread
            failed.append(problem)
            job_failed.set()

    thread = threading.Thread(target=work, name="beside", daemon=True)
    thread.start()
    try:
        with _ends_with(job_failed):
            yield
    except _Over:
        pass  # the job's own exception says why, below
    except BaseException:
        block_failed.set()
        raise
    finally:
        thread.join()
    if failed:
        raise failed[0]


@contextlib.contextmanager
def _ends_with(event: threading.Event) -> Iterator[None]:
    before: threading.Event | None = getattr(_thread, "over", None)
    _thread.over = event
    try:
        yield
    finally:
        _thread.over = before
