"""Processes side by side at one scene, or ended at any moment: the same answer, and nothing left over."""

import itertools
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from filelock import FileLock

from support import CASES, loaded_scene, working_in
from wakeflow.core.process import cores
from wakeflow.core.sources import kernel_root
from wakeflow.core.store import is_marked, kept_stages

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
        words = "from wakeflow.pipeline import compilation; compilation.compile_tracker()"
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


def test_cleaning_beside_a_run_takes_nothing_from_it(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    child = begin([*VACUUM, "--out", str(tmp_path / "o")], cache)
    while child.poll() is None:
        assert ended(begin(["clean", "--everything"], cache))[0] == 0
    assert ended(child)[0] == 0
    assert is_marked(cache)
    assert ended(begin(["clean", "--everything"], cache))[0] == 0
    assert not kept_stages(cache)


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
