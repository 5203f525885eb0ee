"""Processes side by side at one scene, or ended at any moment: the same answer, and nothing left over."""

import errno
import fcntl
import itertools
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

from support import CASES, ROOT, begun_part, loaded_scene, working_in
from wakeflow.cli import main
from wakeflow.core import store as store_module
from wakeflow.core.executor import Workers
from wakeflow.core.files import kernel_root
from wakeflow.core.process import background, cores, end_group, start_in_group
from wakeflow.core.store import USERS, Store, cache_in_use, is_marked, kept_stages, remove_stages

SEED = 31
KILLS = int(os.environ.get("WAKEFLOW_KILLS", "50"))
AFTER = 5.0  # s in which everything of an ended run is gone, on a machine with a core for each program that runs
VACUUM = ("run", str(CASES / "vacuum.toml"), "--set", "feed.count=64", "--quiet")


def begin(words: tuple[str, ...] | list[str], cache: Path, cwd: Path | None = None) -> "subprocess.Popen[str]":
    """A command line in a process of its own; what it says is kept."""
    environment = {**os.environ, "WAKEFLOW_CACHE": str(cache)}
    command = [sys.executable, "-m", "wakeflow.cli", *words]
    return subprocess.Popen(
        command,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
        cwd=cwd,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # ignored in the background
    )


def test_a_run_does_not_wait_for_another_version_that_compiles() -> None:
    """Versions share the folder of compiled kernels, not what is in it; earlier ones hold their lock there."""
    with FileLock(kernel_root() / "compile-tracker.lock"):
        words = "from wakeflow.flight.stages import compilation; compilation.compile_tracker()"
        subprocess.run([sys.executable, "-c", words], check=True, timeout=500)


def ended(child: "subprocess.Popen[str]") -> tuple[int, str]:
    said = child.communicate(timeout=900)[1]
    assert "Traceback" not in said, said
    return child.returncode, said


def test_three_processes_at_one_scene_one_folder_and_one_cache(tmp_path: Path) -> None:
    cache, shared = tmp_path / "cache", tmp_path / "shared"
    outs = [shared, shared, tmp_path / "own"]
    codes = [ended(one) for one in [begin([*VACUUM, "--out", str(out)], cache) for out in outs]]
    assert sorted(code for code, _ in codes) in ([0, 0, 0], [0, 0, 2])
    assert all("another run is writing to" in said for code, said in codes if code)
    tables = [(out / "separation.csv").read_bytes() for out in (shared, tmp_path / "own")]
    assert tables[0] == tables[1]


def test_cleaning_beside_a_run_takes_nothing_from_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = tmp_path / "cache"
    monkeypatch.setenv("WAKEFLOW_CACHE", str(cache))
    child = begin([*VACUUM, "--out", str(tmp_path / "o")], cache)
    while child.poll() is None:
        assert main(["clean", "--everything"]) == 0
        time.sleep(0.05)
    assert ended(child)[0] == 0
    assert is_marked(cache)
    assert main(["clean", "--everything"]) == 0
    assert not kept_stages(cache)


KEY = "a" * 64


def test_a_run_that_waits_for_the_stage_of_another_ends_when_it_is_told_to(tmp_path: Path) -> None:
    """Its second thread waits, and the first, which hears the signal, waits for the second."""
    (tmp_path / "airflow").mkdir()
    held, waits = os.open(tmp_path / "airflow" / f"{KEY}.lock", os.O_RDWR | os.O_CREAT), threading.Event()
    fcntl.flock(held, fcntl.LOCK_EX)
    other = threading.Timer(30.0, fcntl.flock, [held, fcntl.LOCK_UN])  # the other run's stage ends
    other.start()

    def end() -> None:
        assert waits.wait(20.0)
        raise KeyboardInterrupt

    def job() -> None:
        Store(tmp_path).make("airflow", KEY, lambda part: None, on_wait=waits.set)

    with pytest.raises(KeyboardInterrupt), background([job]):
        end()
    assert other.is_alive()
    other.cancel()
    os.close(held)


@pytest.mark.parametrize("kind", ["link", "file"])
def test_what_is_no_folder_at_the_place_of_an_unfinished_stage_is_replaced(kind: str, tmp_path: Path) -> None:
    store, outside = Store(tmp_path / "cache"), tmp_path / "outside"
    outside.mkdir()
    (tmp_path / "cache" / "airflow").mkdir(parents=True)
    part = tmp_path / "cache" / "airflow" / f"{KEY}.part"
    part.symlink_to(outside) if kind == "link" else part.write_text("?")
    folder, _ = store.make("airflow", KEY, lambda part: (part / "data").write_text("made"))
    assert not list(outside.iterdir())
    assert not folder.is_symlink()
    assert (folder / "data").read_text() == "made"


def test_a_cache_that_others_own_is_not_cleaned_while_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with cache_in_use(tmp_path):
        pass
    plain = os.open

    def refusing(path: Path, flags: int, *more: Any) -> int:
        if Path(path).name == USERS and flags & os.O_RDWR:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return plain(path, flags, *more)

    with monkeypatch.context() as patched:
        patched.setattr(os, "open", refusing)
        reader = cache_in_use(tmp_path)
        assert reader.__enter__()
        with cache_in_use(tmp_path, alone=True) as alone:
            assert not alone
    with cache_in_use(tmp_path, alone=True) as alone:  # its owner cleans
        assert not alone
    reader.__exit__(None, None, None)
    with cache_in_use(tmp_path, alone=True) as alone:
        assert alone


def test_a_disk_without_locks_lets_a_run_read_its_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr(store_module.fcntl, "flock", refuse)
    with cache_in_use(tmp_path) as used:
        assert used
    with cache_in_use(tmp_path, alone=True) as alone:
        assert not alone


@contextmanager
def working(folder: Path, words: str, log: Path) -> "Iterator[subprocess.Popen[bytes]]":
    """A program that works in a folder, as a killed run's solver does."""
    folder.mkdir(parents=True)
    with log.open("wb") as sink:
        child = start_in_group(["sh", "-c", words], folder, os.environ, sink)
    try:
        yield child
    finally:
        end_group(child)


@pytest.mark.parametrize("inner", ["", "case/span"])
def test_a_part_that_a_killed_runs_solver_writes_to_is_not_cleaned(inner: str, tmp_path: Path) -> None:
    Store(tmp_path / "cache").make("airflow", "b" * 64, lambda part: None)
    part = tmp_path / "cache" / "airflow" / f"{KEY}.part"
    with working(part / inner, "sleep 300", tmp_path / "log"):
        unfinished = [one for one in kept_stages(tmp_path / "cache") if not one.finished]
        assert [one.folder for one in unfinished] == [part]
        assert not remove_stages(tmp_path / "cache", unfinished)
        assert part.is_dir()
    assert remove_stages(tmp_path / "cache", unfinished) == unfinished
    assert not part.exists()


def test_a_killed_runs_solver_is_waited_for_two_folders_down(tmp_path: Path) -> None:
    """An airflow in three dimensions runs in part/case/span."""
    seen: list[str] = []
    span = begun_part(tmp_path, "airflow", KEY) / "case" / "span"
    with working(span, "sleep 1; echo late > late", tmp_path / "log") as child:
        threading.Thread(target=child.wait, daemon=True).start()
        Store(tmp_path).make("airflow", KEY, lambda part: seen.append((part / "case" / "span" / "late").read_text()))
    assert seen == ["late\n"]


def test_a_worker_that_dies_as_it_is_ended_leaves_the_others_to_be_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pool = Workers(2, tmp_path)
    for done in [pool.submit(time.sleep, 1.0) for _ in range(2)]:
        done.result()
    first, second = list(pool._alive)
    first.kill()
    first.wait()
    monkeypatch.setattr(first, "poll", lambda: None)  # asked just before
    try:
        pool.end()
        assert second.poll() is not None
    finally:
        end_group(second)


def test_the_loops_beside_the_tests_end_with_their_terminal(tmp_path: Path) -> None:
    shutil.copy(ROOT / "tests" / "beside_loops.sh", tmp_path)
    (tmp_path / "run.sh").write_text("touch begun\nexec sleep 60\n")
    hears = ["env", "--default-signal=HUP", "sh", "beside_loops.sh"]  # also where these tests were started by nohup
    script = subprocess.Popen(hears, cwd=tmp_path, start_new_session=True)
    try:
        _until((tmp_path / "begun").exists)
        os.killpg(script.pid, signal.SIGHUP)
        script.wait(timeout=60)
        _until(lambda: not working_in(tmp_path))
    finally:
        for left in working_in(tmp_path):
            os.kill(left, signal.SIGKILL)
        script.wait()


def _until(holds: Callable[[], bool]) -> None:
    until = time.monotonic() + 20.0
    while not holds():
        assert time.monotonic() < until
        time.sleep(0.05)


@pytest.mark.slow
def test_a_sweep_that_is_started_twice_is_computed_once(tmp_path: Path) -> None:
    words = ["sweep", str(CASES / "vacuum.toml"), "--set", "feed.count=32,64", "--workers", "2", "--quiet"]
    both = [begin([*words, "--out", str(tmp_path / "o")], tmp_path / "cache") for _ in range(2)]
    codes = [ended(one) for one in both]
    assert sorted(code for code, _ in codes) in ([0, 0], [0, 2])
    assert all("another sweep is writing to" in said for code, said in codes if code)


def told(path: Path) -> bytes:
    """A table of answers, without the rows that say how long each took."""
    return b"".join(line for line in path.read_bytes().splitlines(keepends=True) if b",seconds," not in line)


def kill_and_go_on(words: list[str], table: str, folder: Path, whole: bytes, seconds: float) -> None:
    """Start a command again and again, and end it KILLS times at random moments within ``seconds``; then let it end."""
    chance, killed, finished = random.Random(SEED), 0, 0
    for number in itertools.count():
        if killed == KILLS:
            break
        folder.mkdir(exist_ok=True)
        child = begin([*words, "--out", str(folder / "o")], folder / "cache", cwd=folder)
        how, moment = chance.choice([signal.SIGINT, signal.SIGTERM, signal.SIGKILL]), chance.uniform(0.0, seconds)
        try:
            child.wait(moment)
        except subprocess.TimeoutExpired:
            child.send_signal(how)
            killed += 1
        said = child.communicate(timeout=60)[1]
        if child.returncode not in (0, -signal.SIGKILL):
            assert "Traceback" not in said or child.returncode < 0, (number, how, moment, said)
        until = time.monotonic() + AFTER * max(1.0, os.getloadavg()[0] / cores())
        while (left := working_in(folder)) and time.monotonic() < until:
            time.sleep(0.1)
        assert not left, (number, how, moment, left)
        print(f"{number}: {how.name} after {moment:.1f} s, exit code {child.returncode}", flush=True)
        if child.returncode == 0:  # it was quicker: what is there is compared, and it begins anew
            finished += 1
            assert told(folder / "o" / table) == whole, (number, how, moment)
            shutil.rmtree(folder)
    folder.mkdir(exist_ok=True)
    assert ended(begin([*words, "--out", str(folder / "o")], folder / "cache", cwd=folder))[0] == 0
    assert told(folder / "o" / table) == whole
    assert not [*folder.rglob("*.part"), *folder.rglob(".*.tmp")]
    print(f"seed {SEED}: ended {killed} times, whole {finished + 1} times")


@pytest.mark.slow
@pytest.mark.openfoam
@pytest.mark.timeout(20_000)
def test_a_coarse_run_with_slab_and_draws_that_is_killed_again_and_again(tmp_path: Path) -> None:
    loaded_scene().save(tmp_path / "scene.toml")
    words, started = ["run", str(tmp_path / "scene.toml"), "--quiet"], time.monotonic()
    assert ended(begin([*words, "--out", str(tmp_path / "whole")], tmp_path / "cache"))[0] == 0
    spent, whole = time.monotonic() - started, (tmp_path / "whole" / "separation.csv").read_bytes()
    # What is finished is kept, so that a tenth of the run each time comes to every part of it
    kill_and_go_on(words, "separation.csv", tmp_path / "killed", whole, 0.2 * spent)


@pytest.mark.slow
@pytest.mark.timeout(20_000)
def test_a_sweep_on_two_workers_that_is_killed_again_and_again(tmp_path: Path) -> None:
    words = ["sweep", str(CASES / "vacuum.toml"), "--set", "feed.count=16,32,64", "--workers", "2", "--quiet"]
    started = time.monotonic()
    assert ended(begin([*words, "--out", str(tmp_path / "whole")], tmp_path / "cache"))[0] == 0
    spent, whole = time.monotonic() - started, told(tmp_path / "whole" / "sweep.csv")
    kill_and_go_on(words, "sweep.csv", tmp_path / "killed", whole, spent)
