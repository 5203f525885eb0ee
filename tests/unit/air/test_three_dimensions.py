"""Rung 3d: extrusion, disturbance, cost, and a coarse airflow from plan to landings, killed on the way."""

import json
import math
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import wakeflow as wf
from proofs.studies import three_dimensions
from wakeflow.air.foam.case import SpanSpec
from wakeflow.air.foam.spanwise.span_measure import PLANE_BELOW, span_means
from wakeflow.air.foam.spanwise.span_record import apart, des_dissipation
from wakeflow.air.foam.spanwise.span_run import layer_map, make_periodic, record_ends, span_modes
from wakeflow.air.kinds.solved_air import LoadedAir, SpanAir
from wakeflow.air.mesh import plan_mesh
from wakeflow.core.errors import FoamError, SceneError
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.laws import span as span_module
from wakeflow.laws.shape import shapes
from wakeflow.laws.span import Span
from wakeflow.planning.wake import cost_of, family_of
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene
from wakeflow.scene.overrides import changes_of

OFF = {"collisions": False, "basset-history": False, "air-loading": False}
SPAN = Span(depth=2.0, layers=8, sheddings=2.0)
BOUNDARY = """FoamFile { version 2.0; }
2
(
    front
    {
        type            empty;
        inGroups        1(empty);
        nFaces          10;
        startFace       7;
    }
    back
    {
        type            patch;
        nFaces          10;
        startFace       17;
    }
)
"""


def spec_with(span: Span) -> SpanSpec:
    body = shapes["rhombus"](width=0.05, slope_angle=math.pi / 4)
    mesh = plan_mesh([body], width=0.4, top=0.2, bottom=-0.4, names=["rhombus"], rung="standard")
    return SpanSpec(mesh, 5.0, 1.2, 1.8e-5, turbulence="kOmegaSSTDDES", stepping="time-resolved", span=span)


def test_front_and_back_become_a_pair(tmp_path: Path) -> None:
    file = tmp_path / "boundary"
    file.write_text(BOUNDARY)
    make_periodic(file, 0.1)
    text = file.read_text()
    assert text.count("cyclic;") == 2
    assert "neighbourPatch  back" in text.split("back\n")[0]
    assert "(0 0 -0.1)" in text
    assert "(0 0 0.1)" in text
    assert "empty" not in text
    assert text.count("nFaces") == 2
    file.write_text(BOUNDARY.replace("back", "outlet"))
    with pytest.raises(FoamError, match="no patch back"):
        make_periodic(file, 0.1)


def test_cells_are_mapped_to_the_plane_in_any_order() -> None:
    random = np.random.default_rng(0)
    plane = random.uniform(size=(50, 2))
    order = random.permutation(np.tile(np.arange(50), 4))
    centres = np.column_stack([plane[order], random.uniform(size=200)])
    np.testing.assert_array_equal(layer_map(centres, plane, 1.0), order)
    centres[3, 0] += 1e-3
    with pytest.raises(FoamError, match="beside the cell"):
        layer_map(centres, plane, 1.0)


def test_the_disturbance_is_strong_periodic_and_always_the_same() -> None:
    spec = spec_with(SPAN)
    behind = np.column_stack([np.zeros(64), np.full(64, -0.085), np.linspace(0.0, 0.1, 65)[:-1]])
    made = span_modes(spec, behind)
    np.testing.assert_array_equal(made, span_modes(spec, behind))
    np.testing.assert_allclose(made, span_modes(spec, behind + np.array([0.0, 0.0, 0.1])), atol=1e-12)
    assert 0.15 * spec.speed < np.sqrt((made**2).mean()) < 0.6 * spec.speed
    assert np.abs(made.mean(axis=0)).max() < 1e-9  # the mean over the span is the plane wake's
    far = behind * (1.0, 0.0, 1.0) + np.array([0.0, 0.15, 0.0])
    assert np.abs(span_modes(spec, far)).max() < 1e-3 * spec.speed


def test_segments_end_on_snapshots_and_the_last_one_with_the_record() -> None:
    ends = np.array(record_ends(Span(2.0, 8, 0.6), 0.01)) / 0.01
    beats = ends / span_module.CADENCE
    np.testing.assert_allclose(beats, np.round(beats), atol=1e-9)
    assert ends[-1] >= span_module.START_UP + 3.6 - 1e-9
    assert (np.diff(ends) > 0).all()


def test_dissipation_is_that_of_the_cells_where_they_resolve_more_than_the_model() -> None:
    k, omega = np.array([1.0, 1.0]), np.array([10.0, 1e4])
    found = des_dissipation(k, omega, np.full(2, 0.01))
    assert found[0] == pytest.approx(1.0 / (0.6 * 0.01))  # the model's own length, 1.1 m, is longer than the cell
    assert found[1] == pytest.approx(0.09 * 1e4)


def test_the_cost_is_cells_by_steps() -> None:
    one, finer = cost_of(Span(2.5, 20, 30.0), 8000.0, 1.0), cost_of(Span(2.5, 40, 30.0), 32000.0, 0.5)
    assert one.core_seconds == pytest.approx(one.cells * one.steps * 3e-6)
    assert finer.core_seconds == pytest.approx(16 * one.core_seconds)
    assert 1.0 < one.core_seconds / 3600 < 6.0
    assert "core-hours" in str(one)
    assert "42 core-minutes" in str(cost_of(Span(2.5, 20, 30.0), 8000.0 / 1.6**2, 1.6))


@pytest.mark.parametrize(
    ("body", "family"),
    [("rhombus", "rhombus"), ("prism-up", "triangle-up"), ("prism-down", "triangle-down"), ("square", "square"),
     ("steep-rhombus", "rhombus")],
)  # fmt: skip
def test_every_body_of_the_study_has_a_second_span(body: str, family: str) -> None:
    assert body in three_dimensions.BODIES
    scene = three_dimensions.scene_of(body, 64, changes_of(three_dimensions.SECOND_SPAN))
    assert family_of(scene).name == family
    assert make_plan(scene, rung="3d").airflow.span == Span(4.0, 32, 40.0)
    assert three_dimensions.spec_of(scene).mesh.projected_width == pytest.approx(0.05)
    assert [name for name in three_dimensions.BODIES if f"{body}-coarse".startswith(name)] == [body]  # of --analyse


def test_the_plan_states_the_cost_before_and_takes_the_scenes_span(rhombus: Scene) -> None:
    plan = make_plan(rhombus.replace({"numerics.span": {"depth": 3.0, "shedding_cycles": 10.0}}), rung="3d")
    assert plan.airflow.span == Span(3.0, 24, 10.0)
    assert any("core-minutes" in line for line in plan.used)
    assert not any("truth lies" in line for line in plan.warnings)
    standard = make_plan(rhombus, rung="standard")
    assert plan.estimate["seconds"] > 10 * standard.estimate["seconds"]
    assert plan.summary()["airflow"]["span"] == {"depth": 3.0, "layers": 24, "sheddings": 10.0}


def test_it_is_solved_under_the_granules_force(rhombus: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = make_plan(rhombus, rung="3d")
    assert plan.airflow.loaded
    pipeline = Pipeline(rhombus, plan)
    air = pipeline.air
    assert isinstance(air, LoadedAir)
    assert isinstance(air.bare, SpanAir)
    assert air.bare.start is pipeline.airs.steady[0]
    given: list[object] = []
    monkeypatch.setattr(SpanAir, "solved", lambda self, force: given.append(force))
    vars(pipeline.loading).update(_way=SimpleNamespace(force="what they exert"))
    air.make_solution()
    air.bare.make_solution()
    assert given == ["what they exert", None]


def test_a_laminar_wake_has_no_such_rung_and_one_below_shedding_is_steady(rhombus: Scene) -> None:
    assert rhombus.reynolds is not None
    at = [rhombus.replace({"air.speed": 5.0 * number / rhombus.reynolds}) for number in (100.0, 20.0)]
    with pytest.raises(SceneError, match="laminar"):
        make_plan(at[0], rung="3d", force={"basset-history": False})
    assert make_plan(at[1], rung="3d", force={"basset-history": False}).airflow.stepping == "steady"


COARSE = {
    "numerics.mesh_scale": 3.5,
    "numerics.span": {"depth": 1.0, "layers": 4, "shedding_cycles": 1.0},
    "feed.count": 64,
}
RUN = """
import json, os, signal, sys
from pathlib import Path
from wakeflow.core.store import Store
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.laws import span
from wakeflow.planning.make import make_plan
from wakeflow.scene import Scene
span.START_UP = 4.0
scene = Scene.load(sys.argv[1]).replace(json.loads(sys.argv[2]))
def hear(stage, text):
    if "three dimensions, t = " in text and list(Path(sys.argv[3]).glob("airflow/*/case/packed/*.npy")):
        os.kill(os.getpid(), signal.SIGKILL)
plan = make_plan(scene, rung="3d", force=json.loads(sys.argv[4]))
Pipeline(scene, plan, store=Store(Path(sys.argv[3])), listener=hear).air.in_case.solution
"""


def packed_of(root: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in root.glob("airflow/*/case/packed/*.npy")}


@pytest.mark.openfoam
@pytest.mark.timeout(3600)  # two airflows, each a minute of a core of its own
def test_a_coarse_airflow_from_plan_to_landings_killed_on_the_way(
    cases: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(span_module, "START_UP", 4.0)
    scene = Scene.load(cases / "rhombus.toml").replace(COARSE)
    words = [str(cases / "rhombus.toml"), json.dumps(COARSE), str(tmp_path / "killed"), json.dumps(OFF)]
    # It kills itself in the middle of a segment: on a busy machine, who looks from outside may look when it is over
    assert subprocess.run([sys.executable, "-c", RUN, *words], check=False).returncode == -signal.SIGKILL
    told: list[str] = []
    # The tracker is compiled in the session's own cache; beside OpenFOAM it would be compiled once more, in this one.
    monkeypatch.setattr("wakeflow.flight.stages.pipeline.Compilation.begin", lambda *_, **__: None)
    monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path / "killed"))
    result = wf.run(
        scene, tmp_path / "out", rung="3d", force=OFF, target_error=0.5, refine=False, report=False,
        listener=lambda _, text: told.append(text),
    )  # fmt: skip
    found = result.airflow
    assert any("three dimensions, t = " in line and "left" in line for line in told)
    assert found.span.layers == 4
    assert found.span.w_rms > PLANE_BELOW
    assert len(found.span.quarters) == 4
    assert max(found.span.axis.across) > 0.1
    assert 0.0 < max(found.span.axis.coherent) < max(found.span.axis.across)
    assert found.turbulence == "kOmegaSSTDDES"
    assert 1.0 < found.cd.value < 4.0
    assert abs(found.mass_error or 0.0) < 1e-3
    parts = {part.source: part for part in result.landings.budget[0].parts}  # type: ignore[union-attr]
    assert parts["airflow-model"].how == "unknown"
    assert sum(result.share("wheat", bin_)[0] for bin_ in [*scene.bin, "elsewhere"]) == pytest.approx(1.0)

    monkeypatch.setenv("WAKEFLOW_CACHE", str(tmp_path / "undisturbed"))
    column = three_dimensions.deep(scene)  # the study's way to an airflow
    assert packed_of(tmp_path / "killed") == packed_of(tmp_path / "undisturbed")
    assert [field.period for field in column.fields] == [pytest.approx(found.period)] * len(found.span.flown)
    three_dimensions.print_table("rhombus", three_dimensions.spec_of(scene), scene, [column], fly=False)
    three_dimensions.print_proof(column, three_dimensions.spec_of(scene))
    said = capsys.readouterr().out
    assert "residence time" in said
    assert f"{found.span.w_rms:.3f} U" in said


def test_what_moves_alike_along_the_whole_span_is_told_from_what_does_not() -> None:
    """v = A cos(2 pi t) + B cos(2 pi z + 2 pi t) + 1: variance (A^2 + B^2)/2 at a point, A^2/2 of the span's mean."""
    spec, layers, times = spec_with(SPAN), 8, np.arange(16) / 16
    alike, waving = 0.6, 0.3
    snapshots = np.zeros((len(times), layers, 3, 6))
    z = np.arange(layers)[:, None] / layers
    for snapshot, t in zip(snapshots, times, strict=True):
        snapshot[..., 0] = 1 + alike * np.cos(2 * np.pi * t) + waving * np.cos(2 * np.pi * (z + t))
    centres = np.array([[0.0, -0.1], [0.01, -0.12], [0.0, 0.1]])  # two in the near wake, one before the body
    record = SimpleNamespace(
        order=np.zeros((layers, 3), dtype=int),
        depth=0.1,
        edge=np.ones(3),
        plane=SimpleNamespace(mesh=SimpleNamespace(plane=SimpleNamespace(centres=centres))),
        since=lambda begin: zip(times, snapshots, strict=True),
    )
    found = span_means(spec, record, 0.0)  # type: ignore[arg-type]
    np.testing.assert_allclose(found.stresses[:, 0], 0.5 * (alike**2 + waving**2))
    np.testing.assert_allclose(found.coherent, 0.5 * alike**2)
    np.testing.assert_allclose(found.three_dimensional[1], waving / 2)  # rms of u and v, of which v alone waves


def test_layers_that_are_flown_in_lie_apart() -> None:
    class Record:
        depth = 0.125
        order = np.zeros((20, 3))

    assert apart(Record(), 0.05, 0.02) == [0, 4, 8, 12, 16]  # type: ignore[arg-type]
    assert apart(Record(), 0.05, 0.05) == [0, 10]  # type: ignore[arg-type]
    assert apart(Record(), 0.05, 1.0) == [0]  # type: ignore[arg-type]
