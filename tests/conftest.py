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


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the long validation as well")


def pytest_configure(config: pytest.Config) -> None:
    # Before any test module imports the tracker: its compiled kernel lives in the cache too. Kept between sessions.
    os.environ["WAKEFLOW_CACHE"] = os.environ.get("WAKEFLOW_TEST_CACHE") or str(ROOT / "runs" / ".test-cache")
    sys.addaudithook(_only_marked_tests_start_programs)


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
