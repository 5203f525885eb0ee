"""Every study runs, at its smallest setting."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from proofs.report import cell
from proofs.studies import bounds, collisions, costs, flakes, laws, search_gain, target_error
from proofs.studies.__main__ import app
from proofs.studies.deposition import MESHES
from support import CASES, ROOT, loaded_scene, shipped
from wakeflow.laws.best_estimate import wakes
from wakeflow.laws.collision import impact_models
from wakeflow.laws.material import default_margins, materials

# tests/unit/laws/test_collision.py, tests/unit/air/test_robustness.py, tests/unit/air/test_three_dimensions.py,
# tests/unit/planning/test_plan_gate.py, tests/unit/planning/test_collisions.py
ELSEWHERE = {"crowding", "gates", "printed_form", "robustness", "three_dimensions"}
SLOW = (pytest.mark.slow, pytest.mark.openfoam)  # half a minute; tested in sweeps, pipeline, foam
VARIANTS = ["the program's own", "pressure: one level of cells at a time"]


def study(*words: object) -> Any:
    """What a study returns, asked for by its command line."""
    return app([str(word) for word in words])


def test_every_study_is_tried() -> None:
    """Named in this file, or tried elsewhere."""
    named = {name for name in app if f'"{name}' in Path(__file__).read_text()}
    assert {name for name in app if not name.startswith("-")} <= named | ELSEWHERE


def test_what_a_stage_costs_is_told_over_seeds(tmp_path: Path) -> None:
    asked = "cost_by_seed", "vacuum", "--seeds", 2, "--count", 256, "--cache", tmp_path / "cache"
    rows = study(*asked)
    assert study(*asked) == rows  # what the runs took is kept
    whole = next(row for row in rows if row["stage"] == "whole")
    assert whole["seeds"] == 2
    assert whole["largest"] >= whole["median"] > 0.0
    assert {"tracks", "draws"} <= {row["stage"] for row in rows}


@pytest.mark.openfoam
def test_chaff_alone_lands_where_it_does_without_lift_but_for_the_scatter_of_its_spin() -> None:
    """Of a glume the lift takes a sixth out of the inner bins, to either side of the heap."""
    chaff = study("chaff_alone", "--count", 1024, "--mesh-scale", 3.0)
    inner = {row["chaff as"]: float(row["inner"].split()[0]) for row in chaff}
    assert inner["flake, no spin lift"] > 88.0
    assert 70.0 < inner["flake"] < inner["flake, no spin lift"]


def test_kernels_go_along_a_slope_as_the_material_says_and_a_ball_as_a_ball() -> None:
    """Rigid ellipsoids are the source of wheat's impact model and scatter, and of how far these may be off."""
    wheat, margins = materials["wheat"], default_margins()
    row = flakes.kernel_row("wheat", flakes.USUAL, 600, level=False)
    assert row["drop"] == pytest.approx(wheat.restitution, abs=0.02)
    assert row["off"] == pytest.approx(1.0, abs=0.1)
    mobility, scatter = 1.0 / impact_models[wheat.impact].inertia, wheat.rebound_scatter
    assert abs(row["turns"] - mobility) < margins["inverse_inertia"].half(mobility, "typical", 1.0)
    for way in ("by_velocity", "by_landing"):
        assert abs(row[way] - scatter) < margins["rebound_scatter"].half(scatter, "typical", 1.0)
    ball, _ = flakes.thrown(np.full(3, 4e-3), 1.6, math.pi / 4, 0.5, 0.3, 8, kind=flakes.Kernels)
    rolls = 1.6 * math.sqrt(0.5) * np.array([5 / 7, 0.0, 0.5])
    np.testing.assert_allclose(ball.velocity, np.tile(rolls, (8, 1)), atol=0.02)


@pytest.mark.parametrize(
    ("words", "column", "found"),
    [
        (["best_estimate"], "{entry.name}", [entry.name for entry in wakes()]),
        (["deposition", "--count", 4], "{mesh}", list(MESHES)),
        (["collision_speed", 60], "{forces}", ["drag, gravity", "all four"]),
        (["injection_or_resolved", 64, CASES / "vacuum.toml"], "{fraction}", ["soft", "hard"]),
        pytest.param(
            ["impaction", 3, "--quick"], "{body}", [next(iter(bounds.BODIES)), "K = tau v / h"],
            marks=pytest.mark.openfoam,
        ),
        pytest.param(["labyrinth", 64, 4], "{fraction}", list(shipped("labyrinth").fraction), marks=SLOW),
        (["flakes_in_air", "--count", 60], "{restitution}", ["0.2", "0.5"]),
        (["flakes", "--count", 8], "{plate}", ["6 x 2 x 0.2", "3 x 3 x 0.1", "10 x 3 x 0.2", "12.65 x 3.69 x 3.69"]),
        (["kernels", "--count", 8], "{kernel}", ["wheat", "wheat, Sakha 93", "barley"]),
        pytest.param(["locked_band", "--quick"], "{ratio}", ["0.5"], marks=pytest.mark.openfoam),
        pytest.param(["vibrating_air", "--quick"], "{frequency:.0f}", ["30"], marks=SLOW),
        pytest.param(["mpi_ranks", "--quick"], "{gain:|}", [""], marks=(*SLOW, pytest.mark.mpi)),
        pytest.param(["time_resolved_cost", "runs", *VARIANTS, "--quick"], "{variant}", VARIANTS, marks=SLOW),
    ],
)  # fmt: skip
def test_a_study_runs_small(
    words: list[object], column: str, found: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert list(dict.fromkeys(cell(column, row) for row in study(*words))) == found


def test_collision_draws() -> None:
    """Where hardly a granule meets another, a number moves the slab's shares as it moves those of granules alone."""
    rows = study("collision_draws", "vacuum", "--draws", 12, "--count", 512, "--rate", 2.0)
    assert [row["fraction"] for row in rows] == [*shipped("vacuum").fraction, "all"]
    assert abs(rows[-1]["slope"] - 1.0) <= rows[-1]["half"] < 0.5


def test_plan_times() -> None:
    """Seconds, not minutes or milliseconds: so small a run says no more on a machine that may do ten other things."""
    rows = study("plan_times", "vacuum", "vacuum", "--rung", "none", "--count", 16, "--stages")
    assert [row["scene"] for row in rows] == ["vacuum", "vacuum"]
    assert all(0.01 < row["by_new"] < 10.0 and 0.01 < row["by_learned"] < 10.0 for row in rows)
    assert {stage.name for stage in rows[0]["stages"]} >= {"tracks", "companion", "report"}


def test_target_error(capsys: pytest.CaptureFixture[str]) -> None:
    """The scenes of "target_error" without air, to a wide target: as quick as the best fixed setting."""
    everything = list(target_error.scenes())
    assert len({name for name, _ in everything}) == len(everything) == 20
    (found,) = target_error.table(everything[-1:], (0.06,))
    assert found["met"]
    assert found["led"].half <= 0.06
    assert found["fixed"].half <= 0.06
    assert "within the target against the reference: 1 of 1 scenes" in capsys.readouterr().out


def test_throughput(tmp_path: Path) -> None:
    found = study("throughput", tmp_path / "throughput.png", "--scene", "vacuum", "--quick")["vacuum"]
    assert [row["rate"] for row in found] == [0.0, *collisions.FEED_RATES[1::2]]
    few, many = (row["hard"]["meetings"] for row in found[1:])
    assert 0.0 < few < many
    assert (tmp_path / "throughput.png").stat().st_size > 0


def test_the_cylinder_of_impaction() -> None:
    for row in bounds.cylinder():
        assert row["plan"] == pytest.approx(row["exact"], abs=0.02)


@pytest.mark.slow
@pytest.mark.openfoam
def test_air_loading() -> None:
    """The scene "air_loading" of tests/unit/flight/test_dense_feeds.py, whose airflow is in the cache."""
    passes, answers = laws.tables(loaded_scene(), force={"basset-history": False})
    assert [row["number"] for row in passes] == list(range(len(passes)))
    assert passes[0]["force"] == 0.0
    assert all(row["force"] > 0.0 for row in passes[1:])  # on the air, against its flow
    assert passes[-1]["cd"] < passes[0]["cd"]
    assert passes[-1]["speed"] < passes[0]["speed"]
    assert answers[1]["cd"] < answers[0]["cd"]


@pytest.mark.slow
@pytest.mark.openfoam
def test_passes_that_do_not_settle_find_the_force_of_those_that_do() -> None:
    """On a coarse mesh; a share of 512 granules moves by two of them where one is turned at an edge."""
    settled, quick = study("settled_passes", "rhombus", "--seeds", 1, "--most", 120, "--mesh-scale", 4.0)
    assert quick["iterations"] < settled["iterations"]
    assert quick["cd_off"] < 0.5
    assert quick["share_off"] < 1.0


def test_a_wakes_end_covers_its_known_mean() -> None:
    rows = study("wake_ends", "--seeds", 20)
    decided = [row["covers"] for row in rows if row["spread"] > 0.01]
    assert np.mean(decided) > 0.9
    assert all(row["latest"] < 1.8 for row in rows if row["memory"] < 0.5)


@pytest.mark.slow
@pytest.mark.openfoam
def test_shares_do_not_depend_on_the_intervals_of_noise() -> None:
    """On a coarse mesh; a change of four standard errors comes once in thousands."""
    for row in study("intervals", "rhombus", "--repeats", 1, "--coarse"):
        change, error = (float(word) for word in row["change"].split(" ± ")) if row["change"] != "-" else (0.0, 1.0)
        assert abs(change) < 4.0 * error, row["name"]


@pytest.mark.openfoam
def test_domain() -> None:
    """Two rows: the distances asked for, and those that the program chooses."""
    rows = study("domain", "draft", "--quick")
    assert [(f"{row['before']:.1f}", f"{row['behind']:.1f}") for row in rows] == [("3.5", "8.0"), ("8.8", "17.6")]
    assert rows[1]["largest"] == "+0.00 ± 0.00"


def test_kernel_speed() -> None:
    """This checkout against itself."""
    words = ["kernel_speed", ROOT / "src", "--pairs", "1", "--only", "contact, captured"]
    command = [sys.executable, ROOT / "tests" / "proofs" / "studies", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "1 of 1 flights are identical, bit by bit" in done.stdout
    assert "all: median ratio" in done.stdout


def test_rebound() -> None:
    """Every part alone, and all of them, on the paper's granules in a vacuum: scatter alone moves wheat."""
    rows = {row["percent"]: row for row in study("rebound", "--count", 256)}
    assert list(rows) == list(laws.ROWS)
    assert rows["scatter by shape"]["wheat, outer"] != rows["the paper's point mass"]["wheat, outer"]
    paper = laws.scene_of(shipped("rhombus"), laws.ROWS["the paper's point mass"])
    assert not any(fraction.varies for fraction in paper.fraction.values())


def test_search_gain() -> None:
    """A row a way; nobody judges to have kept more than there is; of the best of all the best has lost nothing."""
    rows = study("search_gain", "vacuum", "--seeds", 1, "--budget", 1.0)
    assert [row["way"] for row in rows] == list(search_gain.WAYS)
    assert all(0.0 <= value <= 1.0 for row in rows for value in row["worth"])
    assert min(row["lost"] for row in rows) == 0.0


@pytest.mark.slow
@pytest.mark.openfoam
def test_sweeps_from_neighbours(tmp_path: Path) -> None:
    from proofs.studies.costs import neighbours

    (row,) = neighbours(tiny=True)
    assert row["speed"] == 5.5
    assert row["near"][0] < row["rest"][0]
    assert row["near"][2] == pytest.approx(row["rest"][2], rel=2e-4)  # what counts as standing still


@pytest.mark.slow
@pytest.mark.openfoam
def test_more_threads_fly_the_same() -> None:
    rows = study("threads", "draft", "--count", 64)
    assert all(row["same"] for row in rows)
    assert all(1.0 <= row["by4"] <= row["by8"] <= 8.0 for row in rows)


@pytest.mark.openfoam
def test_a_scenes_tolerance_hardly_moves_shares() -> None:
    """Grain lands where it does at a far smaller tolerance; of dust, some granules change their bin."""
    rows = {row["kind"]: row for row in study("share_error", "draft", "--count", 64)}
    assert rows["wheat"]["moved"] == 0.0
    assert all(abs(row["change"]) <= row["moved"] <= 0.2 for row in rows.values())


def test_blocks_are_handed_out_as_threads_become_free() -> None:
    assert costs.makespan([3.0, 1.0, 1.0, 1.0], 2) == 3.0
    assert costs.makespan([1.0, 1.0, 3.0], 2) == 4.0


@pytest.mark.slow
def test_two_workers_against_one(capsys: pytest.CaptureFixture[str]) -> None:
    study("sweep_speed", "tracks", "--tiny")
    assert "tracking bounds: one worker" in capsys.readouterr().out
