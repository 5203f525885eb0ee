"""Sweeps on a Dask cluster: the table of a local sweep, whichever worker dies meanwhile."""

import csv
from pathlib import Path
from threading import Thread

import pytest

import wakeflow as wf
from support import CASES, LoopbackCluster, shipped
from wakeflow.answer.result import Request
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.many.agenda import make_agenda

COMMAND = ["sweep", str(CASES / "vacuum.toml"), "--quiet", "--set", "feed.count=64"]
COMMAND += ["--set", "fraction.hard.restitution=0.3,0.5,1.5"]


def rows(folder: Path) -> list[dict[str, str]]:
    """sweep.csv as it is, but for the time that each scene and its airflow took."""
    with (folder / "sweep.csv").open() as stream:
        return [row for row in csv.DictReader(stream) if row["quantity"] not in ("seconds", "airflow.seconds")]


@pytest.fixture(scope="module")
def local(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a local sweep, which the others must equal."""
    folder = tmp_path_factory.mktemp("here")
    assert main([*COMMAND, "--workers", "1", "--out", str(folder)]) == 1
    return folder


@pytest.fixture
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path / "cache"))


@pytest.mark.usefixtures("_own_cache")
def test_a_cluster_gives_the_table_of_a_local_sweep(running: LoopbackCluster, local: Path, tmp_path: Path) -> None:
    """By the command with an address, and from Python with a client, which is left open."""
    import distributed

    assert main([*COMMAND, "--out", str(tmp_path / "address"), "--scheduler", running.address]) == 1
    assert rows(tmp_path / "address") == rows(local)
    assert {row["state"] for row in rows(local)} == {"done", "failed"}
    assert list((tmp_path / "address" / "workers").glob("*/log.worker-1"))
    with distributed.Client(running.address, set_as_default=False) as client:
        scene = shipped("vacuum", {"feed.count": 64})
        sweep = wf.sweep([scene], tmp_path / "client", scheduler=client)
        assert client.status == "running"
    assert sweep.failed == {}
    with pytest.raises(SceneError, match="of this machine"):
        wf.sweep([shipped("vacuum")], tmp_path, scheduler=running.address, workers=2)


@pytest.mark.usefixtures("_own_cache")
def test_a_worker_that_dies_with_its_scene_changes_nothing(
    running: LoopbackCluster, local: Path, tmp_path: Path
) -> None:
    killed: list[int] = []

    def kill() -> None:
        worker = running.worker_at_work()
        killed.append(worker.pid)
        worker.kill()

    thread = Thread(target=kill)
    thread.start()
    assert main([*COMMAND, "--out", str(tmp_path), "--scheduler", running.address]) == 1
    thread.join()
    assert killed
    assert rows(tmp_path) == rows(local)


def test_an_airflow_in_three_dimensions_asks_for_its_cores(tmp_path: Path) -> None:
    found = wf.variants(shipped("rhombus"), {"numerics.ranks": [6, "auto"], "numerics.rung": ["standard", "3d"]})
    agenda = make_agenda(found, tmp_path, Request(None, None, {}, None))
    asked = {step.name: step.ranks for step in agenda.steps if step.airflow}
    assert sorted(asked.values()) == [1, 2, 6, 6]
    assert {step.ranks for step in agenda.steps if not step.airflow} == {1}
