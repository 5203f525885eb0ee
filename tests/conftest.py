"""Shared by all tests: one cache for the whole session, so that parallel workers compute each airflow once; markers
that say which outside program a test starts, and skip it where that is missing; shipped scenes.
"""

import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import unchanged

# As in a run: threads of BLAS that wait for each other took three times as long. Read when numpy is loaded
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

ROOT = Path(__file__).parents[1]
PROGRAMS = {  # by marker: what a test with it may start
    "openfoam": (
        "DPMFoam", "MPPICFoam", "checkMesh", "decomposePar", "gmshToFoam", "icoUncoupledKinematicParcelFoam",
        "pimpleFoam", "reconstructPar", "simpleFoam",
    ),
    "mpi": ("mpirun",),
    "liggghts": ("liggghts",),
    "browser": ("chromium",),
}  # fmt: skip
_HOMES = {shutil.which(name): marker for marker, names in PROGRAMS.items() for name in names}
_HOMES.pop(None, None)
_running: dict[str, pytest.Item] = {}
NARROWED = ("keyword", "markexpr", "deselect", "lf", "failedfirst", "maxfail", "collectonly", "last_failed")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the long validation as well")
    parser.addoption("--all", action="store_true", help="run test files too that are as they were when they passed")


def pytest_configure(config: pytest.Config) -> None:
    # Before any test module imports the tracker: its compiled kernel lives in the cache too. Kept between sessions.
    os.environ["WAKEFLOW_CACHE"] = os.environ.get("WAKEFLOW_TEST_CACHE") or str(ROOT / "runs" / ".test-cache")
    sys.addaudithook(_only_marked_tests_start_programs)
    config.stash[PASSED] = Passed(config)
    if not hasattr(config, "workerinput"):
        config.pluginmanager.register(config.stash[PASSED])


PASSED = pytest.StashKey["Passed"]()


class Passed:
    """Which test files passed as they are now, and are left out; which have passed in this session."""

    def __init__(self, config: pytest.Config) -> None:
        self.folder = Path(os.environ["WAKEFLOW_CACHE"]) / "passed"
        missing = sorted(name for marker in PROGRAMS.values() for name in marker if shutil.which(name) is None)
        self.mode = f"slow={config.getoption('--slow')} without={missing}"
        self.narrowed = any(config.getoption(name, None) for name in NARROWED)
        self.asked = {Path(word.partition("::")[0]).resolve() for word in config.args}
        self.whole = {path for path in self.asked if path.is_dir()} if "::" not in "".join(config.args) else set()
        self.seen: set[Path] = set()
        self.failed: set[Path] = set()
        if hasattr(config, "workerinput"):
            self.left_out = {Path(name) for name in config.workerinput["unchanged"]}
        elif config.getoption("--all") or self.narrowed:
            self.left_out = set()
        else:
            files = {file for folder in self.whole for file in folder.rglob("test_*.py")} - self.asked
            self.left_out = unchanged.unchanged(files, self.folder, self.mode)

    @pytest.hookimpl(optionalhook=True)
    def pytest_configure_node(self, node: Any) -> None:
        """A worker of xdist leaves out the same files."""
        node.workerinput["unchanged"] = [str(file) for file in self.left_out]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        file = (ROOT / report.nodeid.partition("::")[0]).resolve()
        self.seen.add(file)
        if report.failed:
            self.failed.add(file)

    def pytest_sessionfinish(self, session: pytest.Session, exitstatus: int) -> None:
        """Note what passed as a whole; a session that ended early, or ran a part of a file, notes nothing."""
        if exitstatus == pytest.ExitCode.NO_TESTS_COLLECTED and self.left_out:
            session.exitstatus = pytest.ExitCode.OK
        ended = exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED)
        if ended and not self.narrowed and "::" not in "".join(session.config.args):
            for file in self.seen - self.failed:
                unchanged.note_passed(file, self.folder, self.mode)

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if self.left_out:
            terminalreporter.write_line(f"{len(self.left_out)} test files are as they were when they passed: left out")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    return True if collection_path in config.stash[PASSED].left_out else None


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    missing = {marker for marker, names in PROGRAMS.items() if any(shutil.which(name) is None for name in names)}
    for item in items:
        if "slow" in item.keywords and not config.getoption("--slow"):
            item.add_marker(pytest.mark.skip(reason="long; add --slow"))
        for marker in missing.intersection(item.keywords):
            item.add_marker(pytest.mark.skip(reason=f"needs {', '.join(PROGRAMS[marker])}"))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Any:
    """Note which test runs, its fixtures of any scope included."""
    _running["test"] = item
    try:
        return (yield)
    finally:
        del _running["test"]


def _only_marked_tests_start_programs(event: str, arguments: tuple[Any, ...]) -> None:
    """An audit hook: a test without the marker would fail where the program is missing, and be slow where it is not."""
    if event != "subprocess.Popen" or "test" not in _running:
        return
    for word in map(str, arguments[1] if isinstance(arguments[1], list | tuple) else [arguments[1]]):
        marker = _HOMES.get(shutil.which(word, path=(arguments[3] or os.environ).get("PATH")))
        if marker is not None and marker not in _running["test"].keywords and word in PROGRAMS[marker]:
            raise RuntimeError(f"{_running['test'].nodeid} starts {word} without the marker {marker}")


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A Result of the shipped vacuum on 256 granules with its whole report, which nobody changes."""
    import wakeflow as wf
    from support import shipped  # not above: the program is imported after its cache is named

    return wf.run(shipped("vacuum", {"feed.count": 256}), tmp_path_factory.mktemp("small") / "vacuum")


@pytest.fixture(scope="session")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A Dask cluster of two workers on this machine."""
    from support import LoopbackCluster

    with LoopbackCluster(tmp_path_factory.mktemp("dask"), workers=2) as cluster:
        yield cluster


@pytest.fixture
def no_screen() -> Iterator[None]:
    """Figures of pyplot are drawn into memory and closed."""
    from matplotlib import pyplot

    before = pyplot.get_backend()
    pyplot.switch_backend("agg")
    yield
    pyplot.close("all")
    pyplot.switch_backend(before)


@pytest.fixture
def cases() -> Path:
    return ROOT / "cases"


@pytest.fixture
def rhombus() -> Any:
    """The shipped rhombus as it is, a Scene."""
    from support import shipped

    return shipped("rhombus")


@pytest.fixture
def draft() -> Any:
    """The shipped rhombus on the rung draft, a Scene."""
    from support import shipped

    return shipped("rhombus", {"numerics.rung": "draft"})


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Debian's chromium, driven by playwright."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        yield started
        started.close()
