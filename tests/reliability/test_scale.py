"""Very many granules, bins, fractions, bodies, scenes: seconds and memory, printed by ``pytest -s --slow``."""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

import wakeflow as wf
from support import Page, shipped
from wakeflow.core.errors import SceneError, known
from wakeflow.runs.time_budget import quick_settings
from wakeflow.scene import Scene

WITHIN = 1.5  # times the memory that the plan states


class Spent(NamedTuple):
    """What a command took: wall ``seconds`` and the most memory (bytes) of one of its processes."""

    seconds: float
    memory: float


def spent(words: list[str], cache: Path) -> Spent:
    """Run a command line in a process of its own, to its end."""
    command = [sys.executable, "-m", "wakeflow.cli", *words]
    started = time.monotonic()
    environment = {**os.environ, "WAKEFLOW_CACHE": str(cache)}
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE) as child:
        said = known(child.stderr).read().decode()
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
    assert (child.returncode, said) == (0, "")
    return Spent(time.monotonic() - started, 1024.0 * used.ru_maxrss)


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("count", [100_000, 1_000_000, 10_000_000])
def test_granules_take_the_memory_that_the_plan_states(count: int, tmp_path: Path) -> None:
    """Both fractions together have at least so many; the replicates are powers of two."""
    scene = shipped("vacuum", {"feed.count": count // 2})
    scene.save(tmp_path / "scene.toml")
    words = ["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "o"), "--until", "tracks", "--quiet"]
    took, stated = spent(words, tmp_path / "cache"), wf.plan(scene).estimate.memory
    print(f"{count} granules: {took.seconds:.0f} s, {took.memory / 1e6:.0f} MB, stated {stated / 1e6:.0f} MB")
    assert took.memory < WITHIN * stated


def _many_bins() -> Scene:
    tables = shipped("vacuum").tables()
    edges = [-0.3 + 0.6 * i / 10_000 for i in range(10_001)]
    tables["bin"] = {f"b{i}": {"from": edges[i], "to": edges[i + 1]} for i in range(10_000)}
    for fraction, target in zip(tables["fraction"].values(), ("b6000", "b7000"), strict=True):
        fraction["target"] = target
    return Scene.parse(tables)


def _many_fractions() -> Scene:
    tables = shipped("vacuum").tables()
    hard = tables["fraction"]["hard"]
    tables["fraction"] = {f"f{i}": {**hard, "restitution": 0.1 + 0.5 * i / 300} for i in range(300)}
    return Scene.parse(tables)


def _many_bodies() -> Scene:
    """Ten rows of twenty small prisms below each other."""
    tables = shipped("vacuum").tables()
    prism = {**tables["body"]["prism"], "width": 0.01}
    places = [(0.028 * (i % 20 - 9.5), -0.02 * (i // 20)) for i in range(200)]
    tables["body"] = {f"p{i}": {**prism, "at": list(place)} for i, place in enumerate(places)}
    tables["channel"]["bottom"] = -0.3
    tables["feed"] |= {"position": places[0][0] + 0.0025, "width": 0.004}
    return Scene.parse(tables)


MANY: dict[str, Callable[[], Scene]] = {
    "10 000 bins": _many_bins,
    "300 fractions": _many_fractions,
    "200 bodies": _many_bodies,
}


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("what", MANY)
def test_a_scene_of_very_many_runs_and_its_page_opens(what: str, tmp_path: Path) -> None:
    scene = MANY[what]().replace({"feed.count": 16})
    scene.save(tmp_path / "scene.toml")
    started = time.monotonic()
    stated = wf.plan(scene).estimate.memory
    planned = time.monotonic() - started
    took = spent(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "o"), "--quiet"], tmp_path / "cache")
    size = (tmp_path / "o" / "report.html").stat().st_size / 1e6
    print(
        f"{what}: planned in {planned:.1f} s, run in {took.seconds:.0f} s, {took.memory / 1e6:.0f} MB; page {size:.1f}"
    )
    assert not Page((tmp_path / "o" / "report.html").read_text()).open
    shares = wf.Result.load(tmp_path / "o").separation["fractions"]
    assert all(sum(one["value"] for one in row.values()) == pytest.approx(1.0) for row in shares.values())
    assert took.memory < WITHIN * stated


def test_the_plan_of_very_many_fractions_states_what_they_hold() -> None:
    """A run of 300 held 678 MB, in its numbers and its report."""
    stated = wf.plan(_many_fractions().replace({"feed.count": 16})).estimate.memory
    assert 678e6 / 1.2 < stated < 1.2 * 678e6
    assert wf.plan(shipped("vacuum")).estimate.memory < 0.7 * stated


@pytest.mark.slow
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("count", [20, 200, 2000])
def test_a_sweep_of_many_scenes(count: int, tmp_path: Path) -> None:
    """Each with other granules, so that nothing is shared."""
    seeds = ",".join(map(str, range(count)))
    shipped("vacuum", {"feed.count": 16}).save(tmp_path / "scene.toml")
    words = ["sweep", str(tmp_path / "scene.toml"), "--set", f"feed.seed={seeds}", "--out", str(tmp_path / "o")]
    took = spent([*words, "--quiet"], tmp_path / "cache")
    table = (tmp_path / "o" / "sweep.csv").stat().st_size / 1e6
    print(f"{count} scenes: {took.seconds / count:.2f} s a scene, {took.memory / 1e6:.0f} MB, table {table:.1f} MB")
    again = wf.sweep(
        wf.variants(Scene.load(tmp_path / "scene.toml"), {"feed.seed": list(range(count))}), tmp_path / "o"
    )
    assert len(again.table.entries) == count


QUICKLY = """
import os, sys
import wakeflow as wf
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1])  # one stage after the other
wf.run(sys.argv[1], sys.argv[2], quick=True, listener=lambda stage, text: print(stage, flush=True))
"""


@pytest.mark.slow
@pytest.mark.openfoam
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", ["vacuum", "aspirator", "labyrinth", "rhombus"])
def test_each_stage_holds_the_memory_that_the_plan_states(name: str, tmp_path: Path) -> None:
    """The run with all programs that it starts. What is read between two lines of a listener is of the later's stage;
    what comes after the last is the report.
    """
    psutil = pytest.importorskip("psutil")
    scene, asked = quick_settings(shipped(name), {})
    stated = {cost.name: cost.memory for cost in wf.plan(scene, **asked).stages}
    shipped(name).save(tmp_path / "scene.toml")
    words = [sys.executable, "-c", QUICKLY, str(tmp_path / "scene.toml"), str(tmp_path / "o")]
    environment = {**os.environ, "WAKEFLOW_CACHE": str(tmp_path / "cache")}
    heard, held, most = tmp_path / "heard", dict[str, float](), 0.0
    with heard.open("w") as listener, subprocess.Popen(words, env=environment, stdout=listener) as child:
        lines = 0
        while child.poll() is None:
            most = max(most, _memory(psutil, child.pid))
            told = heard.read_text().splitlines()
            if len(told) > lines:  # lines of one moment: all of the same
                held[told[-1]] = max(held.get(told[-1], 0.0), most)
                lines, most = len(told), 0.0
            time.sleep(0.05)
    assert child.returncode == 0
    held["report"] = most
    for stage, memory in held.items():
        print(f"{name}, {stage}: {memory / 1e6:.0f} MB, stated {stated.get(stage, 0.0) / 1e6:.0f} MB")
    over = {stage: memory for stage, memory in held.items() if memory > WITHIN * stated.get(stage, float("inf"))}
    assert not over
    assert len(held.keys() & stated.keys()) > 2


def _memory(psutil: Any, number: int) -> float:
    """Bytes of a process and of all that it started, each with the libraries that it shares with the others."""
    found = 0.0
    with contextlib.suppress(psutil.NoSuchProcess):
        first = psutil.Process(number)
        for one in (first, *first.children(recursive=True)):
            with contextlib.suppress(psutil.NoSuchProcess):
                found += one.memory_info().rss
    return found


def test_a_hundred_thousand_unknown_keys_are_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text("\n".join(f"k{n} = 1" for n in range(100_000)))
    started = time.process_time()
    with pytest.raises(SceneError, match="more than 80000 keys"):
        Scene.load(path)
    assert time.process_time() - started < 1.0
