"""A disk that is full, a terminal without letters, a home that is not there: one line, and what is finished is kept."""

import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from wakeflow.core.errors import FoamError
from wakeflow.foam.watch import Watch

SMALL = ("--set", "feed.count=64")


def started(words: list[str], environment: dict[str, str], before: Callable[[], None] | None = None) -> tuple[int, str]:
    """Exit code and stderr of a command line in a process of its own."""
    command = [sys.executable, "-m", "wakeflow.cli", *words]
    done = subprocess.run(
        command,
        env=environment,
        capture_output=True,
        preexec_fn=before,
        timeout=300,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    said = done.stderr.decode("utf-8", "replace")
    assert "Traceback" not in said
    return done.returncode, said


@pytest.fixture
def plain(tmp_path: Path) -> dict[str, str]:
    """An environment with a cache of its own."""
    return {**os.environ, "WAKEFLOW_CACHE": str(tmp_path / "cache")}


def test_a_terminal_that_has_ascii_alone_shows_the_tables(cases: Path, tmp_path: Path, plain: dict[str, str]) -> None:
    bare = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}
    environment = {key: value for key, value in (plain | bare).items() if key != "HOME"}
    code, said = started(["run", str(cases / "vacuum.toml"), *SMALL, "--out", str(tmp_path / "o")], environment)
    assert (code, (tmp_path / "o" / "result.json").exists()) == (0, True), said


def test_a_file_of_limited_size_is_one_line_and_the_same_command_goes_on(
    cases: Path, tmp_path: Path, plain: dict[str, str]
) -> None:
    """As a quota, or a disk that is full in the middle of a file."""

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    words = ["run", str(cases / "vacuum.toml"), *SMALL, "--out", str(tmp_path / "o"), "--quiet"]
    code, said = started(words, plain, limit)
    assert code == 3
    assert said.count("\n") == 1
    assert "free some space, what is finished is kept, the same command goes on" in said
    assert not list(tmp_path.rglob("*.tmp"))
    assert started(words, plain) == (0, "")


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_a_folder_that_cannot_be_written_is_one_line(cases: Path, tmp_path: Path, plain: dict[str, str]) -> None:
    (tmp_path / "o").mkdir(mode=0o500)
    code, said = started(["run", str(cases / "vacuum.toml"), "--out", str(tmp_path / "o")], plain)
    assert (code, said.count("\n")) == (2, 1)


@pytest.mark.parametrize("name", ["a b", "é ü", "=1+1", "-x", "a'b\"c", "x" * 200, "$(id)", "a%sb", "a\nb"])
def test_odd_paths_are_written_to(name: str, cases: Path, tmp_path: Path, plain: dict[str, str]) -> None:
    scene = tmp_path / f"{name}.toml"
    shutil.copy(cases / "vacuum.toml", scene)
    code, said = started(
        ["run", str(scene), *SMALL, "--out", str(tmp_path / name), "--until", "tracks", "--quiet"], plain
    )
    assert (code, (tmp_path / name / "result.json").exists()) == (0, True), said


def begun(
    cases: Path, folder: Path, plain: dict[str, str], number: int, heard: signal.Handlers
) -> subprocess.Popen[str]:
    """A run that has begun, in a process that hears this signal or was told to ignore it (as by nohup)."""
    words = ["run", str(cases / "vacuum.toml"), "--set", "feed.count=200000", "--out", str(folder), "--quiet"]
    child = subprocess.Popen(
        [sys.executable, "-m", "wakeflow.cli", *words],
        env=plain,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(number, heard),
    )
    until = time.monotonic() + 100
    while not (folder / ".lock").exists() and time.monotonic() < until:
        time.sleep(0.02)
    return child


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_run_that_is_told_to_end_says_that_the_same_command_goes_on(
    number: int, cases: Path, tmp_path: Path, plain: dict[str, str]
) -> None:
    child = begun(cases, tmp_path / "o", plain, number, signal.SIG_DFL)
    child.send_signal(number)
    _, said = child.communicate(timeout=100)
    assert child.returncode == 128 + number
    assert said == "wakeflow: interrupted; what is finished is kept, the same command goes on\n"


def test_a_run_started_with_nohup_outlives_its_terminal(cases: Path, tmp_path: Path, plain: dict[str, str]) -> None:
    child = begun(cases, tmp_path / "o", plain, signal.SIGHUP, signal.SIG_IGN)
    child.send_signal(signal.SIGHUP)
    with pytest.raises(subprocess.TimeoutExpired):
        child.wait(timeout=1)
    child.send_signal(signal.SIGTERM)
    child.communicate(timeout=100)
    assert child.returncode == 128 + signal.SIGTERM


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A folder of programs, instead of all others."""
    (tmp_path / "bin").mkdir()
    for name in ("sh", "setpriv", "env"):
        if found := shutil.which(name):
            (tmp_path / "bin" / name).symlink_to(found)
    return tmp_path / "bin"


OTHERS = {
    "absent": None,
    "of another kind": "echo 'Welcome to a solver'; exit 0",
    "too old": "echo 'Using: OpenFOAM-2.3 (see www.OpenFOAM.org)'; exit 1",
    "garbage": "head -c 100000 /dev/urandom; exit 1",
}


@pytest.mark.parametrize("kind", OTHERS)
def test_an_openfoam_that_is_none_is_one_line(
    kind: str, cases: Path, tmp_path: Path, programs: Path, plain: dict[str, str]
) -> None:
    if (script := OTHERS[kind]) is not None:
        for name in ("simpleFoam", "pimpleFoam", "gmshToFoam", "checkMesh"):
            (programs / name).write_text(f"#!/bin/sh\n{script}\n")
            (programs / name).chmod(0o755)
    words = ["run", str(cases / "rhombus.toml"), "--rung", "draft", "--set", "numerics.mesh_scale=4"]
    code, said = started([*words, "--out", str(tmp_path / "o"), "--quiet"], plain | {"PATH": str(programs)})
    assert code == 3
    assert said.startswith("wakeflow: ")
    assert len(said.splitlines()[0]) <= len("wakeflow: ") + 300


LINES = (
    "Time = abc",
    "deltaT = x",
    "smoothSolver:  Solving for Ux, Initial residual = foo, Final residual = 1, No Iterations 2",
    "Time = " + "9" * 5000 + "x",
    "Time = \x1b[31m",
)


@pytest.mark.parametrize("line", LINES)
def test_a_solver_that_prints_garbage_is_an_error_of_the_solver(line: str, tmp_path: Path) -> None:
    watch = Watch(tmp_path, "steady", lambda progress: None, expected=10.0)
    with pytest.raises(FoamError, match=r"the solver printed .*, which holds no number") as caught:
        watch(line)
    assert str(caught.value).isprintable()
