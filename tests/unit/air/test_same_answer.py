"""The same answer everywhere: an airflow does not depend on the load of the machine, nor on how often it was killed."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from support import CASES, RHOMBUS, ROOT, WIDTH, kept_airflow, rhombus_spec, shipped, working_in
from wakeflow.air.foam import watch
from wakeflow.air.foam.airflow import solve_airflow
from wakeflow.air.foam.case import FlowSpec
from wakeflow.air.foam.programs import AirflowFailure
from wakeflow.air.foam.read import time_folders
from wakeflow.air.foam.solver import last_state, segment_ends
from wakeflow.air.foam.statistics import oscillation
from wakeflow.air.foam.steady import (
    SEGMENT,
    STATES_KEPT,
    WINDOW,
    _apart,
    _stands_still,
    _will_not_settle,
    expected_end,
)
from wakeflow.air.foam.time_resolved import _has_started, _looks
from wakeflow.air.foam.watch import Progress, Watch
from wakeflow.air.mesh import build_mesh, plan_mesh


def airflow(stepping: str) -> FlowSpec:
    """A rhombus in two thousand cells over some hundred iterations; or in a thousand, laminar, to wide intervals."""
    if stepping == "steady":
        return rhombus_spec()
    mesh = plan_mesh([RHOMBUS], width=5 * WIDTH, top=3 * WIDTH, bottom=-6 * WIDTH, rung="standard", scale=4.0)
    return FlowSpec(mesh, 1.0, 1.2, 1.2 * WIDTH / 100, turbulence="laminar", stepping="time-resolved", accuracy=0.2)


SOLVE = """
import sys
from pathlib import Path
sys.path[:0] = [{tests!r}, {here!r}]
from test_same_answer import airflow
from wakeflow.air.foam.airflow import solve_airflow
solve_airflow(airflow({stepping!r}), Path({msh!r}), Path({case!r}), start=Path({start!r}) if {start!r} else None)
"""


def killed(command: list[str], folder: Path, delays: list[float], **how: Any) -> int:
    """Start ``command`` in ``folder`` again and again, each time killed after so many seconds with every process that
    works there or below, then let it end. Returns how often it was killed.
    """
    count = 0
    for delay in [*delays, None]:
        with subprocess.Popen(command, start_new_session=True, cwd=folder, **how) as process:
            try:
                assert process.wait(delay) == 0
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                count += 1
        for other in working_in(folder):  # the solver leads a group of its own
            with suppress(ProcessLookupError):
                os.kill(other, signal.SIGKILL)
    return count


@contextmanager
def loaded_machine(folder: Path) -> Iterator[None]:
    """Each process that works in ``folder`` stands still now and then, for others to compute: at random, by itself."""

    over = Event()

    def halt() -> None:
        chance = np.random.default_rng()
        while not over.wait(chance.uniform(0.0, 0.2)):
            halted = [process for process in working_in(folder) if chance.random() < 0.5]
            for process in halted:
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGSTOP)
            over.wait(chance.uniform(0.0, 0.2))
            for process in halted:
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGCONT)

    other = Thread(target=halt)
    other.start()
    try:
        yield
    finally:
        over.set()
        other.join()


def told(case: Path) -> dict[str, Any]:
    table: dict[str, Any] = json.loads((case / "airflow.json").read_text())
    del table["seconds"]
    return table


def stored(case: Path) -> dict[str, str]:
    """The checksum of every stored field, by time and name; 0 holds the start, or the template's again."""
    files = [path for folder in time_folders(case) for path in folder.iterdir() if path.is_file()]
    return {str(path.relative_to(case)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.openfoam
@pytest.mark.parametrize(
    ("stepping", "developed"), [("steady", False), ("time-resolved", False), ("time-resolved", True)]
)
def test_neither_load_nor_kills_change_an_airflow(stepping: str, developed: bool, tmp_path: Path) -> None:
    """One run in peace, one killed again and again whose processes are left little of the machine; from rest, or from
    a wake that is ``developed`` already.
    """
    spec, start = airflow(stepping), None
    if developed:
        start = kept_airflow(replace(spec, speed=0.9 * spec.speed))[0] / "case"
    build_mesh(spec.mesh, tmp_path)
    begun = time.monotonic()
    solve_airflow(spec, tmp_path / "mesh.msh", tmp_path / "quiet", start=start)
    seconds = time.monotonic() - begun
    assert len(segment_ends(tmp_path / "quiet")) >= 2
    script = SOLVE.format(
        tests=str(ROOT / "tests"), here=str(Path(__file__).parent), stepping=stepping, msh=str(tmp_path / "mesh.msh"),
        case=str(tmp_path / "disturbed"), start="" if start is None else str(start),
    )  # fmt: skip
    delays = list(1.0 + seconds * np.random.default_rng().uniform(0.1, 0.35, 3))  # a second to start Python
    (tmp_path / "disturbed").mkdir()
    with loaded_machine(tmp_path / "disturbed"):
        assert killed([sys.executable, "-c", script], tmp_path / "disturbed", delays) >= 2
    assert told(tmp_path / "disturbed") == told(tmp_path / "quiet")
    assert stored(tmp_path / "disturbed") == stored(tmp_path / "quiet")


SCENE = {  # a coarse mesh, and a short slab
    "numerics.mesh_scale": 4.0, "numerics.rung": "draft", "numerics.target_error": 0.05, "numerics.tolerance": 1e-3,
    "feed.count": 32, "feed.rate": 0.005,
}  # fmt: skip


@pytest.mark.openfoam
@pytest.mark.parametrize(
    "changes", [SCENE, pytest.param({}, marks=[pytest.mark.slow, pytest.mark.timeout(7200)])], ids=["small", "shipped"]
)
def test_a_run_that_is_killed_lands_its_granules_in_the_same_places(changes: dict[str, Any], tmp_path: Path) -> None:
    """In peace on all cores; and as a process on one, with a cache of its own: only the compiled kernel is shared."""
    quiet = wf.run(shipped("rhombus", changes), tmp_path / "quiet", report=False).folder
    folder = tmp_path / "killed"
    folder.mkdir()
    scene = f"wf.Scene.load({str(CASES / 'rhombus.toml')!r}, {changes})"
    start = f"import wakeflow as wf; wf.run({scene}, {str(folder / 'out')!r}, report=False)"
    command = ["taskset", "-c", "0", sys.executable, "-c", start]
    environment = {**os.environ, "WAKEFLOW_CACHE": str(folder / "cache")}
    with (folder / "log").open("w") as sink:
        delays = [3.0, 6.0, 5.0] if changes else [30.0, 70.0, 50.0, 40.0]
        killed(command, folder, delays, env=environment, stdout=sink, stderr=sink)
    found, expected = (wf.Result.load(out) for out in (folder / "out", quiet))
    assert found.table["separation"] == expected.table["separation"]
    with np.load(folder / "out" / "granules.npz") as ends, np.load(quiet / "granules.npz") as others:
        assert all(np.array_equal(ends[name], others[name]) for name in others)


def drags(case: Path, values: np.ndarray) -> None:
    """A history of drag coefficients, a step of 1 each."""
    folder = case / "postProcessing" / "forceCoefficients" / "0"
    folder.mkdir(parents=True)
    rows = (f"{i + 1}\t{value:.12g}\t0\t0\n" for i, value in enumerate(values))
    (folder / "coefficient.dat").write_text("# Time Cd Cs Cl\n" + "".join(rows))


def follow(following: Watch, collapse: int) -> None:
    """Let it read a log of 100 steps, the last ones from ``collapse`` on far too short."""
    for step in range(1, 101):
        following(f"Time = {step}")
        following(f"deltaT = {1.0 if step < collapse else 1e-9}")


@pytest.mark.parametrize("every", [0.0, 1e9], ids=["looks at every step", "never looks"])
def test_a_failure_is_the_first_of_the_run_whenever_somebody_looks(
    every: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The drag is impossible at step 60, the time step collapses at step 80; steps 1 to 50 may do what they like."""
    monkeypatch.setattr(watch, "LOOK_EVERY", every)
    following = Watch(tmp_path, "start-up", lambda _: None, expected=100.0, least_step=1e-6)
    drags(tmp_path, np.where(np.isin(np.arange(1, 101), (20, 60, 70)), 12345.0, 1.0))
    with pytest.raises(AirflowFailure, match=r"drag coefficient reached 1\.23e") as failed:
        follow(following, collapse=80)
    assert following.now == (61 if every == 0.0 else 80)
    following.end()  # nothing more is found
    assert "\n" not in str(failed.value)


@pytest.mark.parametrize("every", [0.0, 1e9], ids=["looks at every step", "never looks"])
def test_what_comes_first_in_the_log_is_the_failure_though_the_history_is_ahead(
    every: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watch, "LOOK_EVERY", every)
    following = Watch(tmp_path, "start-up", lambda _: None, expected=100.0, least_step=1e-6)
    drags(tmp_path, np.where(np.arange(1, 101) > 60, 12345.0, 1.0))
    with pytest.raises(AirflowFailure, match="time step collapsed"):
        follow(following, collapse=55)


def test_an_impossible_drag_that_nobody_looked_at_is_found_at_the_end(tmp_path: Path) -> None:
    following = Watch(tmp_path, "steady", lambda _: None, expected=100.0)
    drags(tmp_path, np.where(np.arange(1, 101) > 60, 12345.0, 1.0))
    with pytest.raises(AirflowFailure, match="drag coefficient"):
        following.end()


def test_time_left_is_told_over_the_segments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr(watch.time, "monotonic", lambda: clock[0])
    seen: list[Progress] = []
    drags(tmp_path, np.ones(100))
    following = Watch(tmp_path, "steady", seen.append, expected=100.0)
    for begin in (0, 40):
        following.begin()
        for step in range(begin + 1, begin + 41):
            clock[0] += 0.5
            following(f"Time = {step}")
        following.end()
        clock[0] += 10.0  # starting the next one is no part of the pace
    assert [now.time for now in seen] == list(range(1, 81))
    assert seen[-1].left == pytest.approx((100 - 80) * 0.5, rel=0.02)


def test_the_end_of_a_steady_run_is_told_from_how_its_drag_settles() -> None:
    count = np.arange(1.0, 3001.0)
    settling = 2.0 + np.exp(
        -count / 150.0
    )  # a window's range is (e^2 - 1) exp(-n/150): a part 2e-4 of the mean at 1452
    assert expected_end(settling[:300], 3000) == 900
    for so_far in (900, 1200):
        assert expected_end(settling[:so_far], 3000) == pytest.approx(1452, abs=20)
    assert expected_end(settling[:1700], 3000) == 1700 + 100  # the wake may take longer: one segment more
    swinging = 2.0 + 0.2 * np.sin(count / 20.0)
    assert 900 + 100 < expected_end(swinging[:900], 3000) <= 900 + 100 + 8 * 75  # eight states of it are kept
    slow = 2.0 + 0.1 * np.exp(-count / 2000.0)
    assert expected_end(slow[:900], 3000) == 3000


def test_a_resumed_recording_looks_again_where_it_looked_before() -> None:
    """Looks at the ends so far, each with the record up to it: cut anywhere, the next one is the same."""
    spec = airflow("time-resolved")
    scale = spec.convective_time
    clock = np.arange(0.0, 200.0, 0.05) * scale
    phase = 2 * np.pi * clock / (6 * scale) + 0.3 * np.sin(clock / scale / 17)
    rows = np.column_stack([clock, 2 + 0.1 * np.cos(2 * phase), np.sin(phase), -1 + 0.1 * np.cos(2 * phase)])
    ends: list[float] = []
    over, look = False, 40 * scale
    while not over:
        ends.append(look)
        over, look = _looks(spec, rows[rows[:, 0] <= ends[-1] * (1 + 1e-9)], ends, 40 * scale)
        assert (over, look) == _looks(spec, rows, ends, 40 * scale)  # rows beyond the last end change nothing
        assert look > ends[-1]
    assert len(ends) >= 2


def test_only_what_will_not_settle_is_given_up() -> None:
    n = np.arange(1, 1001)
    swing = np.sin(2 * np.pi * n / 28)
    assert _will_not_settle(2 + 0.1 * swing, 3000)
    assert not _will_not_settle((2 + 0.1 * swing)[:800], 3000)  # too early to tell
    assert not _will_not_settle(2 + 0.1 * np.exp(-n / 130) * swing + 8 * np.exp(-n / 40), 3000)
    assert not _will_not_settle(2 + 0.3 * np.exp(-n / 500) * swing, 3000)  # slow, yet there in time
    assert _will_not_settle(2 + 0.3 * np.exp(-n / 500) * swing, 1100)
    assert not _will_not_settle(2 + 0.004 * swing, 3000)  # small enough to be used


@pytest.mark.parametrize("kind", ["settles", "swings", "wanders"])
def test_when_a_steady_run_ends_hardly_depends_on_the_seed(kind: str) -> None:
    """Over 20 seeds of what disturbs its drag: settled, or given up after two looks."""
    n, ends = np.arange(1, 3001), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        walk = 10.0 * np.convolve(rng.normal(size=3100), np.full(101, 1 / 101), "valid")
        drag = {
            "settles": 2 + np.exp(-n / 150) * (1 + 0.3 * walk),
            "swings": 2 + 0.2 * np.sin(n / 20 + 6 * rng.random()) * (1 + 0.3 * walk),
            "wanders": 2 + 0.1 * walk,
        }[kind]
        rows = np.column_stack([n, drag, 0 * n, 0 * n - 1])

        def over(end: int, drag: np.ndarray = drag, rows: np.ndarray = rows) -> bool:
            given_up = _will_not_settle(drag[:end], 3000) and _will_not_settle(drag[: end - SEGMENT], 3000)
            return given_up or _stands_still(rows[end - WINDOW : end])

        ends.append(next(end for end in range(WINDOW, 3000, SEGMENT) if over(end)))
    assert max(ends) <= 1.5 * np.median(ends)


@pytest.mark.parametrize("noise", [0.02, 0.05])
def test_when_a_wake_has_started_hardly_depends_on_the_seed(noise: float) -> None:
    """Over 20 seeds of shedding whose periods vary by a part ``noise``: the look at which the start-up is over."""
    spec, ends = airflow("time-resolved"), []
    clock = np.arange(0.0, 90.0, 0.05)
    for seed in range(20):
        wander = np.interp(clock, np.arange(0.0, 96.0, 6.0), np.random.default_rng(seed).normal(1.0, noise, 16))
        phase = 2 * np.pi * np.cumsum(wander) * 0.05 / 6.0
        grown = 1.0 - np.exp(-clock / 8.0)
        rows = np.column_stack([clock * spec.convective_time, 2 + 0 * clock, grown * np.sin(phase), 0 * clock - 1])
        looks = np.arange(15.0, 86.0, 5.0)
        ends.append(next(look for look in looks if _has_started(rows[clock <= look], spec)))
    assert max(ends) <= 1.5 * np.median(ends)


@pytest.mark.parametrize("length", [17, 28, 119, 200])
def test_states_to_keep_meet_all_phases_of_the_swing(length: int) -> None:
    drag = 2 + 0.1 * np.sin(2 * np.pi * np.arange(600) / length)
    assert oscillation(drag) == pytest.approx(length, rel=0.02)
    apart = _apart(drag)
    assert WINDOW <= STATES_KEPT * apart <= 2 * WINDOW
    phases = np.sort(apart * np.arange(STATES_KEPT) / length % 1.0)
    assert np.diff([*phases, phases[0] + 1]).max() < 0.3
    noise = np.random.default_rng(1).standard_normal(600)
    assert oscillation(noise) == 0
    assert STATES_KEPT * _apart(noise) == 2 * WINDOW


@pytest.mark.openfoam
def test_a_steady_airflow_that_does_not_settle_is_ended_early_and_kept_as_states() -> None:
    """A rhombus at Re 100 in the whole channel sheds: no steady solution."""
    from wakeflow.air.field import FlowField
    from wakeflow.air.foam.read import late_states, read_flow
    from wakeflow.air.kinds.case_field import case_field, state_fields

    spec = airflow("time-resolved")
    spec = FlowSpec(spec.mesh, 1.0, 1.2, 1.2 * WIDTH / 200, turbulence="laminar")
    folder, result = kept_airflow(spec)
    case = folder / "case"
    assert result.verdict != "steady"
    assert result.field_time == "states"
    assert result.steps <= 1500 + 2 * WINDOW  # not the 3000 that it may take
    names = late_states(case)
    assert len(names) == STATES_KEPT
    assert len(set(np.diff([int(name) for name in names]))) == 1
    assert result.steps == int(names[-1]) == last_state(case)
    assert result.cd.low < result.cd.value < result.cd.high
    assert "does not settle" in result.notes[0]

    every, mean = read_flow(case, "states", density=1.2), read_flow(case, "mean", density=1.2)
    assert "period" not in every
    assert list(every["times"]) == [float(name) - float(names[0]) for name in names]
    np.testing.assert_allclose(every["velocity"].mean(axis=0), mean["velocity"], atol=1e-12)
    fields = state_fields(case, 1.2, half=False)
    assert len(fields) == STATES_KEPT
    assert not any(field.in_time for field in fields)
    np.testing.assert_array_equal(fields[3].velocity, FlowField.from_openfoam(case, names[3]).velocity)
    np.testing.assert_allclose(case_field(case, "states", 1.2, half=False).velocity, mean["velocity"], atol=1e-12)
