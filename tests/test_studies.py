"""Every study in cases/studies runs, at its smallest setting; tests/laws and tests/foam look at two of them closely."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import air_loading
import aspirator_curve
import best_estimate
import crowd_draws
import crowd_speed
import domain
import impaction
import injection_or_resolved
import kernel_speed
import labyrinth_chain
import locked_band
import mpi_ranks
import neighbours
import paper_compare
import plan_times
import rebound
import search_gain
import slope_angles
import sweep_speed
import target_error
import throughput
import time_resolved_cost
import wakeflow as wf
from support import CASES, ROOT, loaded_scene, shipped
from wakeflow.laws.best_estimate import wakes

# tests/laws/test_collision.py, tests/foam/test_robustness.py, tests/foam/test_three_dimensions.py,
# tests/planning/test_gates_elsewhere.py, tests/planning/test_crowd.py
ELSEWHERE = {"crowding", "gates", "printed_form", "robustness", "three_dimensions"}
HERE = {
    study.__name__
    for study in (
        air_loading, aspirator_curve, best_estimate, crowd_draws, crowd_speed, domain, impaction, injection_or_resolved,
        kernel_speed, labyrinth_chain, locked_band, mpi_ranks, neighbours, paper_compare, plan_times, rebound,
        search_gain, slope_angles, sweep_speed, target_error, throughput, time_resolved_cost,
    )
}  # fmt: skip


def test_every_study_is_tried() -> None:
    assert {path.stem for path in (CASES / "studies").glob("*.py")} == HERE | ELSEWHERE


def table_rows(text: str) -> list[list[str]]:
    """Cells of the rows, heads apart, of all tables in Markdown."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    rules = [i for i, line in enumerate(lines) if set(line) <= set("| -:")]
    kept = [line for i, line in enumerate(lines) if i not in rules and i + 1 not in rules]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in kept]


def test_crowd_draws(capsys: pytest.CaptureFixture[str]) -> None:
    """Where hardly a granule meets another, a number moves the slab's shares as it moves those of granules alone."""
    ((slope, half),) = crowd_draws.main(["vacuum"], draws=12, count=512, rate=2.0).values()
    assert abs(slope - 1.0) <= half
    assert half < 0.5
    *fractions, _ = table_rows(capsys.readouterr().out)
    assert [row[2] for row in fractions] == list(shipped("vacuum").fraction)


@pytest.mark.slow  # a minute of OpenFOAM; what it times is tested in tests/sweeps, tests/pipeline, tests/foam
@pytest.mark.openfoam
def test_neighbours(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path))  # put back what the study sets
    neighbours.main(["--quick"])
    ((_, speed, rest, near, _, _, cd_rest, cd_near),) = table_rows(capsys.readouterr().out)
    assert float(speed) == 5.5
    assert int(near) < int(rest)
    assert float(cd_near) == pytest.approx(float(cd_rest), rel=2e-4)  # what counts as standing still


def test_plan_times(capsys: pytest.CaptureFixture[str]) -> None:
    """Seconds, not minutes or milliseconds: so small a run, beside others, tells no more."""
    rows = plan_times.main(["vacuum", "vacuum"], rung="none", count=16, stages=True)
    assert all(0.1 < row.new / row.took < 10.0 and 0.1 < row.learned / row.took < 10.0 for row in rows)
    told = table_rows(capsys.readouterr().out)
    assert [row[0] for row in told[:2]] == ["vacuum", "vacuum"]
    assert {row[1] for row in told[2:]} >= {"tracks", "companion", "report"}


def test_target_error(capsys: pytest.CaptureFixture[str]) -> None:
    """Without air, flown from impact to impact, to a wide target: the run is as quick as the best fixed setting."""
    everything = list(target_error.scenes())
    assert len(everything) == 20
    assert len({name for name, _ in everything}) == 20
    (found,) = target_error.main(everything[-1:], (0.06,))
    assert found.met
    assert found.led.half <= 0.06
    assert found.fixed is not None
    assert found.fixed.half <= 0.06
    out = capsys.readouterr().out
    (row,) = table_rows(out)
    assert row[:2] == [everything[-1][0], "6"]
    assert "within the target against the reference: 1 of 1 scenes" in out


def test_aspirator_curve(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    aspirator_curve.main(tmp_path / "curve.png", quick=True)
    rows = table_rows(capsys.readouterr().out)
    assert [float(row[0]) for row in rows] == list(aspirator_curve.SPEEDS[::10])
    assert (tmp_path / "curve.png").stat().st_size > 0


def test_throughput(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    throughput.main([str(tmp_path / "throughput.png"), "--scene", "vacuum", "--quick"])
    rows = table_rows(capsys.readouterr().out)
    assert [row[0] for row in rows] == ["each alone", *(f"{rate:g}" for rate in throughput.RATES[1::2])]
    few, many = (float(row[3]) for row in rows[1:])
    assert 0.0 < few < many  # meetings of a granule
    assert (tmp_path / "throughput.png").stat().st_size > 0


def test_best_estimate(capsys: pytest.CaptureFixture[str]) -> None:
    best_estimate.main()
    assert [row[0] for row in table_rows(capsys.readouterr().out)] == [entry.name for entry in wakes()]


def test_the_cylinder_of_impaction(capsys: pytest.CaptureFixture[str]) -> None:
    impaction.cylinder()
    assert len(table_rows(capsys.readouterr().out)) == len(impaction.K)


@pytest.mark.slow  # a minute of OpenFOAM; what it times is tested in tests/sweeps, tests/pipeline, tests/foam
@pytest.mark.openfoam
def test_air_loading(capsys: pytest.CaptureFixture[str]) -> None:
    """The scene of tests/pipeline/test_air_loading.py, whose airflow is in the cache."""
    air_loading.main(loaded_scene(), force={"basset-history": False})
    rows = table_rows(capsys.readouterr().out)
    passes = [row for row in rows if row[0] in "0123"]
    assert [int(row[0]) for row in passes] == list(range(len(passes)))
    assert float(passes[0][1]) == 0.0
    assert all(float(row[1]) > 0.0 for row in passes[1:])  # on the air, against its flow
    assert float(passes[-1][2]) < float(passes[0][2])  # the body's drag
    assert float(passes[-1][3]) < float(passes[0][3])  # the air before it
    assert [row[0] for row in rows if row[0].startswith("with")] == ["without", "with the steady end's change"]


@pytest.mark.openfoam
def test_domain() -> None:
    """Two rows: the distances asked for, and those that the program chooses."""
    told: list[str] = []
    domain.main(["draft"], told.append, quick=True)
    rows = table_rows("\n".join(told))
    assert [row[:2] for row in rows] == [["3.5", "8.0"], ["8.8", "17.6"]]
    assert rows[1][-2] == "+0.00 ± 0.00"


@pytest.mark.openfoam
def test_impaction(capsys: pytest.CaptureFixture[str]) -> None:
    impaction.main(3.0, quick=True)
    assert table_rows(capsys.readouterr().out)[-2][0] == next(iter(impaction.BODIES))


def test_injection_or_resolved(capsys: pytest.CaptureFixture[str]) -> None:
    injection_or_resolved.main(64, [CASES / "vacuum.toml"])
    assert {row[1] for row in table_rows(capsys.readouterr().out)} == {"soft", "hard"}


def test_kernel_speed() -> None:
    """This checkout against itself."""
    options = ["--against", ROOT / "src", "--pairs", "1", "--only", "contact, captured"]
    command = [sys.executable, kernel_speed.__file__, *options]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "1 of 1 flights are identical, bit by bit" in done.stdout


def test_crowd_speed(capsys: pytest.CaptureFixture[str]) -> None:
    crowd_speed.main(["--granules", "60"])
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 6
    assert all(float(row.split()[-2]) > 0 for row in rows[1:5])


@pytest.mark.openfoam
def test_labyrinth_chain(capsys: pytest.CaptureFixture[str]) -> None:
    labyrinth_chain.main(64, 4.0)
    assert "stages of the other" in capsys.readouterr().out


@pytest.mark.openfoam
def test_locked_band(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    locked_band.main(tmp_path, "rhombus", quick=True)
    assert len(table_rows(capsys.readouterr().out)) == 1


@pytest.mark.slow  # a minute of OpenFOAM; what it times is tested in tests/sweeps, tests/pipeline, tests/foam
@pytest.mark.openfoam
@pytest.mark.mpi
def test_mpi_ranks(tmp_path: Path) -> None:
    told: list[str] = []
    mpi_ranks.main(tmp_path, told.append, scales=(2.0,))
    assert len(table_rows("\n".join(told))) == 1


@pytest.mark.openfoam
def test_paper_compare(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(paper_compare.SCENES, "barrier")  # the costly one; tests/report/test_pictures.py draws it
    few = ["--set", "numerics.mesh_scale=3", "--set", "feed.count=64"]
    assert paper_compare.main([*few, "--force", "collisions=off", "--force", "air-loading=off"]) == 0
    assert {row[1] for row in table_rows(capsys.readouterr().out)} == set(paper_compare.SCENES)


def test_rebound(capsys: pytest.CaptureFixture[str]) -> None:
    """Every part alone, and all of them, on the paper's granules in a vacuum: scatter alone moves wheat."""
    rebound.main(256, "none")
    rows = {row[0]: row[1:] for row in table_rows(capsys.readouterr().out)}
    assert list(rows) == list(rebound.ROWS)
    assert rows["scatter by shape"][0] != rows["the paper's point mass"][0]
    paper = rebound.scene_of(shipped("rhombus"), rebound.ROWS["the paper's point mass"])
    assert not any(fraction.varies for fraction in paper.fraction.values())


def test_search_gain() -> None:
    """A row a way; nobody judges to have kept more than there is."""
    told: list[str] = []
    found = search_gain.main(["vacuum"], 1, 1.0, told.append)
    rows = table_rows("\n".join(told))
    assert [row[1] for row in rows] == list(search_gain.WAYS)
    assert all(0.0 <= value <= 1.0 for values in found.values() for value in values)
    assert min(float(row[-1]) for row in rows) == 0.0  # of the best of all the best has lost nothing


def test_slope_angles(tmp_path: Path) -> None:
    slope_angles.main(tmp_path)
    scenes = sorted(tmp_path.glob("*.toml"))
    assert len(scenes) == len(slope_angles.ANGLES)
    for scene in scenes:
        wf.Scene.load(scene)


@pytest.mark.openfoam
def test_time_resolved_cost(tmp_path: Path) -> None:
    told: list[str] = []
    names = ["the program's own", "pressure: one level of cells at a time"]
    time_resolved_cost.main(tmp_path, names, told.append, time_resolved_cost.QUICK)
    assert [row[0] for row in table_rows("\n".join(told))] == names


@pytest.mark.slow
def test_two_workers_against_one(capsys: pytest.CaptureFixture[str]) -> None:
    sweep_speed.main(["--tiny", "--tracks"])
    assert "tracking bounds: one worker" in capsys.readouterr().out
