"""A disk that is full, a terminal without letters, a home that is not there: one line, and what is finished is kept."""

import itertools
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from support import CASES, working_in
from wakeflow import cli
from wakeflow.air.foam.watch import Watch
from wakeflow.core.errors import FoamError
from wakeflow.core.store import is_marked, kept_stages

SMALL = ("--set", "feed.count=64")
COARSE = (*SMALL, "--rung", "draft", "--set", "numerics.mesh_scale=4", "--set", "numerics.tolerance=1e-3")
SCENES = (
    pytest.param("vacuum", SMALL),
    pytest.param("rhombus", COARSE, marks=[pytest.mark.slow, pytest.mark.openfoam]),
)


def started(words: list[str], environment: dict[str, str], before: Callable[[], None] | None = None) -> tuple[int, str]:
    """Exit code and stderr of a command line in a process of its own."""
    command = [sys.executable, "-m", "wakeflow.cli", *words]
    done = subprocess.run(
        command,
        env=environment,
        capture_output=True,
        preexec_fn=before,
        timeout=1500,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    said = done.stderr.decode("utf-8", "replace")
    assert "Traceback" not in said
    return done.returncode, said


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Exit code and stderr of a command line in this process, with the cache of ``plain``."""
    monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path / "cache"))

    def command(words: list[str]) -> tuple[int, str]:
        capsys.readouterr()
        return cli.main(words), capsys.readouterr().err

    return command


@pytest.fixture
def plain(tmp_path: Path) -> dict[str, str]:
    """An environment with a cache of its own."""
    return {**os.environ, "WAKEFLOW_CACHE": str(tmp_path / "cache")}


ASCII_ALONE = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}


def test_an_odd_environment_without_a_home_is_enough(cases: Path, tmp_path: Path, plain: dict[str, str]) -> None:
    """A terminal that has ASCII alone, a backend that matplotlib does not know."""
    environment = plain | ASCII_ALONE | {"MPLBACKEND": "nonsense"}
    del environment["HOME"]
    code, said = started(["run", str(cases / "vacuum.toml"), *SMALL, "--out", str(tmp_path / "o")], environment)
    assert (code, (tmp_path / "o" / "result.json").exists()) == (0, True), said


def test_a_file_of_limited_size_is_one_line_and_the_same_command_goes_on(
    cases: Path, tmp_path: Path, plain: dict[str, str], here: Any
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
    assert here(words) == (0, "")


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Callable[[str], Path]]:
    """A disk of its own, mounted and mounted again with the options it is called with: only root may do so."""
    folder = tmp_path / "disk"
    folder.mkdir()

    def mounted(options: str) -> Path:
        how = f"remount,{options}" if folder.is_mount() else options
        command = ["mount", "-t", "tmpfs", "-o", how, "none", str(folder)]
        if subprocess.run(command, check=False, capture_output=True).returncode != 0:
            pytest.skip("mounting a small disk is not allowed here")
        return folder

    yield mounted
    if folder.is_mount():
        subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.parametrize("which", ["out", "cache"])
def test_a_folder_that_cannot_be_written_is_one_line(
    which: str, cases: Path, tmp_path: Path, plain: dict[str, str], disk: Callable[[str], Path]
) -> None:
    places = {"out": tmp_path / "o", "cache": tmp_path / "cache"} | {which: disk("ro") / "folder"}
    words = ["run", str(cases / "vacuum.toml"), *SMALL, "--out", str(places["out"]), "--quiet"]
    code, said = started(words, plain | {"WAKEFLOW_CACHE": str(places["cache"])})
    assert (code, said.count("\n")) == (2, 1), said
    assert "choose another --out" in said


def stages_of(cache: Path) -> set[str]:
    """The finished stages of a cache, none where there is no cache yet."""
    found = kept_stages(cache) if is_marked(cache) else []
    return {f"{one.stage}/{one.folder.name}" for one in found if one.finished}


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize(("name", "how"), SCENES)
def test_a_disk_that_is_full_at_every_stage_is_one_line_and_room_lets_it_go_on(
    name: str, how: tuple[str, ...], cases: Path, plain: dict[str, str], disk: Callable[[str], Path]
) -> None:
    """Results and cache on one disk that is larger each time until they fit; an airflow takes most of it."""
    finished: set[str] = set()
    begin, growth = (16_384, 1.4) if how == SMALL else (131_072, 1.8)
    for number in itertools.count():
        room = round(begin * growth**number)
        folder = disk(f"size={room}")
        words = ["run", str(cases / f"{name}.toml"), *how, "--out", str(folder / "o"), "--quiet"]
        code, said = started(words, plain | {"WAKEFLOW_CACHE": str(folder / "cache")})
        kept = stages_of(folder / "cache")
        assert finished <= kept, room
        finished = kept
        print(f"{name}: {room} bytes, {sorted({stage.partition('/')[0] for stage in kept})}: {said[:200]}", flush=True)
        if code == 0:
            break
        first, *more = said.splitlines()
        assert code == 3, (room, said)
        assert all(line.startswith("  ") for line in more), (room, said)
        assert "free some space" in first, (room, said)
    print(f"{name}: {number} times full, up to {room} bytes, with {len(finished)} stages")
    assert number > 3
    assert not [*folder.rglob("*.tmp"), *folder.rglob("*.part")]


LIMITS: dict[str, Callable[[], None]] = {
    "64 open files": lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64)),
    "1 GB of memory": lambda: resource.setrlimit(resource.RLIMIT_DATA, (10**9, 10**9)),
    "one core": lambda: os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1]),
}


@pytest.fixture(scope="module")
def unlimited(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, tuple[str, ...]], bytes]:
    """separation.csv of a scene on this machine as it is."""
    folder = tmp_path_factory.mktemp("unlimited")

    def table(name: str, how: tuple[str, ...]) -> bytes:
        if not (folder / name).exists():
            assert cli.main(["run", str(CASES / f"{name}.toml"), *how, "--out", str(folder / name), "--quiet"]) == 0
        return (folder / name / "separation.csv").read_bytes()

    return table


@pytest.mark.parametrize("limit", LIMITS)
@pytest.mark.parametrize(("name", "how"), SCENES)
def test_little_of_the_machine_is_enough_for_the_same_answer(
    limit: str, name: str, how: tuple[str, ...], cases: Path, tmp_path: Path, plain: dict[str, str],
    unlimited: Callable[[str, tuple[str, ...]], bytes],
) -> None:  # fmt: skip
    words = ["run", str(cases / f"{name}.toml"), *how, "--out", str(tmp_path / "o"), "--quiet"]
    assert started(words, plain, LIMITS[limit]) == (0, "")
    assert (tmp_path / "o" / "separation.csv").read_bytes() == unlimited(name, how)


def test_a_library_that_finds_no_memory_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What the dynamic loader says, as of the pictures' library after the work is done."""

    def load(*_: object, **__: object) -> int:
        raise ImportError("libvtkCommonCore.so: failed to map segment from shared object")

    monkeypatch.setattr(cli, "app", load)
    assert cli.main(["run"]) == 3
    said = capsys.readouterr().err
    assert said.startswith("wakeflow: the memory is full")
    assert said.count("\n") == 1


def test_a_clock_that_is_set_back_changes_nothing(cases: Path, tmp_path: Path, here: Any) -> None:
    """All that a run left is of tomorrow."""
    words = ["run", str(cases / "vacuum.toml"), *SMALL, "--out", str(tmp_path / "o"), "--quiet"]
    assert here(words) == (0, "")
    table, stages = (tmp_path / "o" / "separation.csv").read_bytes(), stages_of(tmp_path / "cache")
    tomorrow = time.time() + 86_400
    for path in tmp_path.rglob("*"):
        os.utime(path, (tomorrow, tomorrow))
    assert here(words) == (0, "")
    assert (tmp_path / "o" / "separation.csv").read_bytes() == table
    assert stages_of(tmp_path / "cache") == stages
    code, said = here(["clean", "--everything", "--yes"])
    assert (code, stages_of(tmp_path / "cache")) == (0, set()), said


@pytest.mark.parametrize("name", ["a b", "é ü", "=1+1", "-x", "a'b\"c", "x" * 200, "$(id)", "a%sb", "a\nb"])
def test_odd_paths_are_written_to(name: str, cases: Path, tmp_path: Path, here: Any) -> None:
    scene = tmp_path / f"{name}.toml"
    shutil.copy(cases / "vacuum.toml", scene)
    code, said = here(["run", str(scene), *SMALL, "--out", str(tmp_path / name), "--until", "tracks", "--quiet"])
    assert (code, (tmp_path / name / "result.json").exists()) == (0, True), said


@pytest.mark.parametrize("words", [["run", f"{'x' * 300}.toml"], ["run", "{scene}", "--out", f"a/{'x' * 300}"]])
def test_a_name_that_no_disk_takes_is_told_so(
    words: list[str], cases: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main([word.format(scene=cases / "vacuum.toml") for word in words]) == 2
    said = capsys.readouterr().err
    assert "too long" in said
    assert "choose a" in said
    assert "WAKEFLOW_CACHE" not in said
    assert said.count("\n") == 1


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


LOSES = """
import ctypes, os, signal, sys, time
import wakeflow.cli as cli

def told(*_):
    os.kill(os.getpid(), signal.{signal})
    time.sleep(0.01)

def work(*_, **__):
    {way}
    time.sleep(60)

cli.app = work
signal.signal(signal.{signal}, signal.SIG_DFL)  # as it is for a program that a shell starts
sys.exit(cli.main())
"""
WAYS = {
    "a callback of C code": "ctypes.CFUNCTYPE(None)(told)()",
    "an except of everything": "try: told()\n    except BaseException: pass",
    "neither": "told()",
    "words of its own for it": "try: told()\n    except BaseException as lost: raise SystemError('is set') from lost",
    "an error that is told": "try: told()\n    except BaseException as lost: raise ImportError('no file') from lost",
    "a traceback that Cython prints": "try: told()\n    except BaseException: sys.excepthook(*sys.exc_info())",
}


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("way", WAYS)
def test_an_interrupt_that_a_library_loses_comes_again(way: str, number: signal.Signals) -> None:
    """LLVM's callbacks lost some that came while the tracker was loaded, and the run went on to its end."""
    code = LOSES.format(signal=number.name, way=WAYS[way])
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=50, check=False)
    assert done.returncode == 128 + number
    assert done.stderr == "wakeflow: interrupted; what is finished is kept, the same command goes on\n"


KERNEL = """
from numba import njit
from numba.core.codegen import JITCodeLibrary

told, given = list, JITCodeLibrary._object_getbuffer_hook.__func__
JITCodeLibrary._object_getbuffer_hook = classmethod(lambda *asked: [code := given(*asked), code and told()][0])

@njit(cache=True)
def kernel(x):
    return 2.0 * x
"""


def test_an_interrupt_while_llvm_asks_for_a_kernel_waits_until_it_has_it(tmp_path: Path) -> None:
    """Raised there, it was lost together with the kernel's code, and the next call of the kernel ended in exit -11."""
    (tmp_path / "kernels.py").write_text(KERNEL)
    env = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    subprocess.run([sys.executable, "-c", "import kernels; kernels.kernel(1.5)"], env=env, check=True, timeout=100)
    code = LOSES.format(signal="SIGTERM", way="import kernels; kernels.told = told; kernels.kernel(1.5)")
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=100, check=False, env=env
    )
    assert done.returncode == 143
    assert done.stderr == "wakeflow: interrupted; what is finished is kept, the same command goes on\n"


SLOW_END = """
class Slow:
    def __del__(self, kill=os.kill, me=os.getpid(), number=signal.SIGTERM, sleep=time.sleep):
        kill(me, number)
        sleep(0.3)

signal.slow = Slow()  # goes when the interpreter ends, where no signal has a handler
"""
ENDS = {
    "lost before": ("try: told()\n    except BaseException: pass\n    return 0", 0),
    "lost before, then a word": ("try: told()\n    except BaseException: pass\n    raise ImportError('x')", 143),
    "not before": ("return 0", 0),
}


@pytest.mark.parametrize("end", ENDS)
def test_an_interrupt_as_the_program_ends_changes_nothing(end: str) -> None:
    """The timer that brings a lost one again killed the process while Python took itself apart: -14, not 143."""
    way, code = ENDS[end]
    script = LOSES.format(signal="SIGTERM", way=way).replace("def work(", f"{SLOW_END}\ndef work(")
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=50, check=False)
    assert done.returncode == code
    assert "Traceback" not in done.stderr


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
    kind: str, cases: Path, tmp_path: Path, programs: Path, monkeypatch: pytest.MonkeyPatch, here: Any
) -> None:
    if (script := OTHERS[kind]) is not None:
        for name in ("simpleFoam", "pimpleFoam", "gmshToFoam", "checkMesh"):
            (programs / name).write_text(f"#!/bin/sh\n{script}\n")
            (programs / name).chmod(0o755)
    words = ["run", str(cases / "rhombus.toml"), "--rung", "draft", "--set", "numerics.mesh_scale=4"]
    monkeypatch.setenv("PATH", str(programs))
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0})  # nothing is compiled beside it
    code, said = here([*words, "--out", str(tmp_path / "o"), "--quiet"])
    assert code == 3
    assert said.startswith("wakeflow: ")
    assert len(said.splitlines()[0]) <= len("wakeflow: ") + 300
    assert kind != "absent" or "apt-get install --no-install-recommends openfoam" in said
    assert not (tmp_path / "o" / "result.json").exists()


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


@pytest.mark.openfoam
def test_a_solver_that_hangs_and_ignores_being_told_to_end_is_ended_by_ctrl_c(
    cases: Path, tmp_path: Path, plain: dict[str, str]
) -> None:
    (tmp_path / "bin").mkdir()
    deaf = tmp_path / "bin" / "simpleFoam"
    deaf.write_text(
        f'#!/bin/sh\n[ $# = 0 ] || exec {shutil.which("simpleFoam")} "$@"\n'
        "trap '' TERM INT\necho Time = 1\nwhile :; do sleep 1; done\n"
    )
    deaf.chmod(0o755)
    words = ["run", str(cases / "rhombus.toml"), *COARSE, "--out", str(tmp_path / "o"), "--quiet"]
    environment = plain | {"PATH": f"{deaf.parent}:{os.environ['PATH']}"}
    child = subprocess.Popen(
        [sys.executable, "-m", "wakeflow.cli", *words],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # ignored in the background
    )
    until = time.monotonic() + 200
    while not list(tmp_path.rglob("log.simpleFoam")) and time.monotonic() < until:
        assert child.poll() is None
        time.sleep(0.1)
    child.send_signal(signal.SIGINT)
    _, said = child.communicate(timeout=120)
    assert (child.returncode, said) == (
        130,
        "wakeflow: interrupted; what is finished is kept, the same command goes on\n",
    )
    assert not working_in(tmp_path / "cache")
