"""Shapes, several bodies, secondary streams, inlet profiles, empty channels and a user's own case, to the numbers."""

import itertools
import json
import math
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from support import shipped
from wakeflow.air.kinds.airflow_kinds import Realisations
from wakeflow.air.kinds.analytic import decaying, duct_field
from wakeflow.answer.separation import separate
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.core.geometry import area, distance_between, distance_to, edges, is_simple, is_symmetric, rounded
from wakeflow.core.record import to_json
from wakeflow.flight import Fate
from wakeflow.flight.feed.feedstock import feedstock
from wakeflow.flight.stages.fraction_flights import Flight, bodies_and_walls, end_lines
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.laws.drag import drag_laws, terminal_velocity
from wakeflow.laws.shape import shapes
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene
from wakeflow.scene.user_files import air_of

STEEP = shapes["rhombus"](width=0.05, slope_angle=math.pi / 3)


def turns(outline: np.ndarray) -> np.ndarray:
    """How much the outline turns at each corner (rad)."""
    start, end = edges(outline)
    after, before = end - start, start - np.roll(start, 1, axis=0)
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.arctan2(cross, (before * after).sum(axis=1))


def test_a_circle_is_a_polygon_on_the_circle() -> None:
    outline = shapes["circle"](width=2.0)
    np.testing.assert_allclose(np.linalg.norm(outline, axis=1), 1.0, rtol=1e-15)
    np.testing.assert_allclose(np.ptp(outline, axis=0), 2.0, rtol=1e-15)
    assert area(outline) == pytest.approx(60 * math.sin(2 * math.pi / 120))
    assert is_symmetric(outline, tolerance=0.0)
    assert is_symmetric(outline[:, ::-1], tolerance=0.0)
    np.testing.assert_allclose(turns(outline), math.radians(3), rtol=1e-9)


@pytest.mark.parametrize("share", [0.05, 0.5, 0.99])
@pytest.mark.parametrize("slope", [10, 45, 80])
@pytest.mark.parametrize("shape", ["rhombus", "prism"])
def test_rounded_corners_touch_their_edges(shape: str, slope: float, share: float) -> None:
    sharp = shapes[shape](width=0.05, slope_angle=math.radians(slope))
    angle = np.abs(turns(sharp))
    start, end = edges(sharp)
    inscribed = 2 * area(sharp) / float(np.linalg.norm(end - start, axis=1).sum())
    with pytest.raises(SceneError, match="eats an edge"):
        rounded(sharp, 1.01 * inscribed)
    radius = share * inscribed
    outline = rounded(sharp, radius)
    assert is_simple(outline)
    assert is_symmetric(outline, tolerance=1e-12)
    assert turns(outline).max() <= math.radians(7.5) + 1e-12
    assert turns(outline).sum() == pytest.approx(2 * math.pi)
    # tangent circles cut r^2 (tan(t/2) - t/2) off each corner; their chords a little more
    kept = area(sharp) - radius**2 * float(np.sum(np.tan(angle / 2) - angle / 2))
    chords = radius**2 * float(angle.sum()) * math.radians(7.5) ** 2 / 12
    assert kept - chords <= area(outline) <= kept + 1e-15
    # every straight stretch that is left lies on an edge of the sharp shape
    start, end = edges(outline)
    straight = distance_to((start + end) / 2, sharp) < 1e-12
    assert np.count_nonzero(straight) == len(sharp)


def test_a_reentrant_corner_is_filled_by_its_arc() -> None:
    notch = shapes["polygon"](points=[[0, 0], [4, 0], [4, 4], [2, 2], [0, 4]])
    outline = rounded(notch, 0.2)
    assert is_simple(outline)
    added = 0.2**2 * (math.tan(math.pi / 4) - math.pi / 4)  # a right angle in: the arc lies on the air's side
    cut = sum(0.2**2 * (math.tan(t / 2) - t / 2) for t in np.radians([90, 90, 135, 135]))
    chords = 0.2**2 * 2 * math.pi * math.radians(7.5) ** 2 / 12
    assert area(outline) == pytest.approx(area(notch) + added - cut, abs=chords)
    assert turns(outline).min() < -0.05


def test_distance_between_outlines() -> None:
    square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    assert distance_between(square, square + np.array([1.5, 0.0])) == pytest.approx(0.5)
    assert distance_between(square, square + np.array([1.3, 1.4])) == pytest.approx(0.5)
    assert distance_between(square, square + np.array([0.5, 0.5])) == 0.0
    assert distance_between(square, 0.1 * square + 0.4) == 0.0  # one inside the other


def test_crossing_edges_are_found() -> None:
    assert is_simple(STEEP)
    assert not is_simple(STEEP[[0, 2, 1, 3]])
    comb = np.array([(0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (1, 1), (1, 2), (0, 2)], dtype=float)
    assert is_simple(comb)  # two of its edges lie on one line, apart


SMALL: dict[str, Any] = {  # a rhombus of 5 cm at Re 24 in a channel of 30 cm
    "body": {"rhombus": {"shape": "rhombus", "width": 0.05, "slope_angle": math.pi / 4}},
    "channel": {"width": 0.3, "top": 0.2, "bottom": -0.2},
    "air": {"speed": 0.2, "viscosity": 5e-4},
    "feed": {"height": 0.1, "width": 0.04, "count": 64},
    "fraction": {"wheat": {"material": "wheat"}, "dust": {"material": "dust"}},
    "bin": {"floor": {"from": -0.15, "to": 0.15}},
    "numerics": {"rung": "draft", "mesh_scale": 2.0},
}
# Meshes of mirrored scenes are no mirror images: Cd differs by 0.7 and 1.5 % on these (slip and no-slip walls), by 0.01
# and 0.13 % with mesh_scale 1.
MESH = 0.02
STREAM = {"position": 0.1, "width": 0.04, "velocity": 0.1}


def small(**changes: Any) -> Scene:
    """The small scene with dotted keys changed; two underscores stand for a dot. Given bodies are all there are."""
    whole = {**SMALL, "body": changes.pop("body", SMALL["body"])}
    return Scene.parse(whole).replace({key.replace("__", "."): value for key, value in changes.items()})


@cache
def solved(text: str) -> Pipeline:
    """The chain of a scene given as JSON, so that tests share it."""
    scene = Scene.parse(json.loads(text))
    return Pipeline(scene, make_plan(scene))


def pipeline_of(scene: Scene) -> Pipeline:
    return solved(json.dumps(scene.tables()))


def profile_at(pipeline: Pipeline, y: float) -> tuple[np.ndarray, np.ndarray]:
    """x (m) across the channel and the velocity (n, 2) m/s there at height ``y``."""
    half = pipeline.scene.channel.width / 2
    x = np.linspace(-0.98 * half, 0.98 * half, 41)
    return x, pipeline.field[1].sample(np.stack([x, np.full(x.shape, y)], axis=1))[0]


def rms(values: np.ndarray) -> float:
    """Root mean square of vectors (n, 2)."""
    return float(np.sqrt(np.mean(np.sum(values**2, axis=1))))


class TestStreams:
    pytestmark = pytest.mark.openfoam

    def test_the_mass_balance_counts_every_stream(self) -> None:
        left = pipeline_of(small(channel__inlet={"low": {"side": "left", **STREAM}}))
        airflow = left.airflow
        assert not left.air.in_case.mesh_spec.half
        assert airflow.flow_rate == pytest.approx(0.2 * 0.3 + 0.1 * 0.04, rel=1e-6)
        assert abs(airflow.mass_error) < 1e-5
        velocity = profile_at(left, 0.1)[1]
        assert velocity[0, 0] > 0.05  # it blows into the channel at its side
        assert abs(velocity[-1, 0]) < 0.03

    def test_a_stream_from_the_other_side_is_the_mirror_image(self) -> None:
        left = pipeline_of(small(channel__inlet={"low": {"side": "left", **STREAM}}))
        right = pipeline_of(small(channel__inlet={"low": {"side": "right", **STREAM}}))
        assert right.airflow.cd.value == pytest.approx(left.airflow.cd.value, rel=MESH)
        for y in (0.06, 0.0, -0.1):  # past the opening, where coarse cells do not blur the stream
            x, one = profile_at(left, y)
            inside = np.abs(x) > 0.03
            other = (profile_at(right, y)[1] * (-1.0, 1.0))[::-1]
            assert rms(one[inside] - other[inside]) < MESH * 0.2

    def test_streams_that_mirror_each_other_are_solved_in_half_of_the_channel(self) -> None:
        both = pipeline_of(small(channel__inlet={side: {"side": side, **STREAM} for side in ("left", "right")}))
        assert both.air.in_case.mesh_spec.half
        assert both.airflow.flow_rate == pytest.approx(0.2 * 0.3 + 2 * 0.1 * 0.04, rel=1e-6)

    def test_granules_leave_through_the_opening(self) -> None:
        scene = small(channel__inlet={"low": {"side": "left", **STREAM}})
        pipeline = pipeline_of(scene)
        grains = wf.Granules(
            position=np.array([(-0.1, 0.1), (-0.1, 0.02)]), velocity=(-5.0, 0.0), diameter=3e-3, density=1300.0
        )
        tracks = wf.track(pipeline.field[1], grains, until=5.0, bodies=bodies_and_walls(scene), lines=end_lines(scene))
        assert [fate.name for fate in map(wf.Fate, tracks.fate)] == ["ESCAPED", "BINNED"]
        assert tracks.position[0, 0] == pytest.approx(-0.15, abs=1e-6)
        assert tracks.impacts[1] > 0  # it met the wall beside the opening


@pytest.mark.parametrize("walls", ["slip", "no-slip"])
class TestWallsAndDirections:
    pytestmark = pytest.mark.openfoam

    def test_upward_air_is_the_mirror_image_of_downward_air(self, walls: str) -> None:
        down, up = (pipeline_of(small(channel__walls=walls, air__direction=way)) for way in ("down", "up"))
        assert up.airflow.cd.value == pytest.approx(down.airflow.cd.value, rel=MESH)
        for y in (0.05, -0.05, -0.15):
            x, one = profile_at(down, y)
            away = np.abs(x) > 0.03
            assert rms(one[away] - (profile_at(up, -y)[1] * (1.0, -1.0))[away]) < MESH * 0.2

    def test_only_a_wall_that_sticks_slows_the_air(self, walls: str) -> None:
        pipeline = pipeline_of(small(channel__walls=walls))
        half = pipeline.scene.channel.width / 2
        at_wall = pipeline.field[1].sample(np.array([(half * (1 - 1e-9), 0.1)]))[0][0]
        if walls == "slip":
            assert at_wall[1] < -0.15
        else:
            assert abs(at_wall[1]) < 1e-6
            slip = pipeline_of(small())
            assert pipeline.airflow.pressure_drop > 2 * slip.airflow.pressure_drop


class TestProfile:
    pytestmark = pytest.mark.openfoam

    def test_a_parabola_stays_one(self) -> None:
        """Fully developed laminar flow: u = 3/2 U (1 - (2 x / W)^2), dp/dy = 12 mu U / W^2."""
        scene = small(
            body={"wire": {"shape": "circle", "width": 0.005, "corners": 32}}, air__profile="parabolic",
            channel={"width": 0.1, "top": 0.5, "bottom": -0.2, "walls": "no-slip", "extend": False},
            bin={"floor": {"from": -0.05, "to": 0.05}}, feed__width=0.004, fraction__wheat__size=0.001,
        )  # fmt: skip
        pipeline = pipeline_of(scene)
        assert (pipeline.air.in_case.mesh_spec.top, pipeline.air.in_case.mesh_spec.bottom) == (0.5, -0.2)
        assert pipeline.airflow.flow_rate == pytest.approx(0.2 * 0.1, rel=1e-9)
        for y in (0.4, 0.2):
            x, velocity = profile_at(pipeline, y)
            np.testing.assert_allclose(velocity[:, 1], -0.3 * (1 - (x / 0.05) ** 2), atol=0.015 * 0.3)
        at = np.array([(0.01, 0.4), (0.01, 0.2)])
        pressure = pipeline.field[1].sample(at)[1]
        assert pressure[0] - pressure[1] == pytest.approx(12 * 5e-4 * 0.2 / 0.1**2 * 0.2, rel=0.02)


class TestSeveralBodies:
    pytestmark = pytest.mark.openfoam

    def scene(self) -> Scene:
        low = {"shape": "prism", "width": 0.06, "slope_angle": math.pi / 3}
        pair = {name: {**low, "at": [x, -0.12]} for name, x in (("left", -0.11), ("right", 0.11))}
        return small(body={**SMALL["body"], **pair})

    def test_each_has_its_drag(self) -> None:
        """At Re 6: at 24 the wakes side by side lean to one side or the other, as real ones do."""
        airflow = pipeline_of(self.scene().replace({"air.speed": 0.05})).airflow
        drag = airflow.cd_of
        assert sum(drag.values()) == pytest.approx(airflow.cd.value, rel=1e-6)
        assert drag["left"] == pytest.approx(drag["right"], rel=MESH)
        assert min(drag.values()) > 0.1

    def test_granules_bounce_between_them(self) -> None:
        pipeline = pipeline_of(self.scene())
        tracked = pipeline.tracks()
        wheat = tracked.landings["wheat"]
        assert set(np.unique(wheat.fate)) <= {wf.Fate.BINNED}
        assert (wheat.impacts >= 2).sum() > 5  # thrown off the first body onto another
        alone = pipeline_of(small()).tracks().landings["wheat"]
        assert wheat.impacts.mean() > 1.1 * alone.impacts.mean()

    def test_a_body_over_the_first_is_met_first(self) -> None:
        above = {"roof": {"shape": "prism", "width": 0.02, "slope_angle": 1.0, "at": [0.0, 0.07]}}
        scene = small(body={**SMALL["body"], **above}, feed__width=0.01, feed__height=0.15)
        pipeline = pipeline_of(scene)
        assert pipeline.plan.fractions["wheat"].mode == "resolved"
        assert pipeline.tracks().fates["wheat"]["stopped"] == 0


def as_given(pipeline: Pipeline, folder: Path, **changes: Any) -> Scene:
    """The chain's own solution as if it were a user's case, in the air of the same scene."""
    shutil.copytree(pipeline.air.in_case.solution[1] / "case", folder / "case", dirs_exist_ok=True)
    tables = pipeline.scene.tables()
    tables["air"] = {"case": "case"}
    del tables["numerics"]
    return Scene.parse(tables, base=folder).replace({key.replace("__", "."): value for key, value in changes.items()})


class TestGivenCase:
    pytestmark = pytest.mark.openfoam

    def test_its_results_are_those_of_the_direct_run(self, tmp_path: Path) -> None:
        own = pipeline_of(small())
        scene = as_given(own, tmp_path)
        assert (scene.air.speed, scene.air.direction) == (0.2, "down")
        assert scene.air.viscosity == pytest.approx(5e-4)
        scene = scene.replace({"air.viscosity": own.scene.air.viscosity})  # to the last bit, which impacts multiply
        given = Pipeline(scene, make_plan(scene))
        assert (given.plan.rung, given.plan.airflow.turbulence) == ("given", "laminar")
        assert any("neither mesh nor solver runs" in line for line in given.plan.used)
        one, other = own.airflow, given.airflow
        assert other.verdict == "given"
        assert other.cd.value == pytest.approx(one.cd.value, rel=0.01)
        assert other.cp_base.value == pytest.approx(one.cp_base.value)
        for key in ("cp_front", "p_inlet", "pressure_drop", "flow_rate", "reynolds"):
            assert getattr(other, key) == pytest.approx(getattr(one, key), rel=1e-9)
        assert to_json(other.suction) == pytest.approx(to_json(one.suction))
        np.testing.assert_array_equal(given.field[1].velocity, own.field[1].velocity)
        for name in scene.fraction:
            assert given.plan.fractions[name].forces == own.plan.fractions[name].forces
            mine, theirs = own.tracks().landings[name], given.tracks().landings[name]
            np.testing.assert_allclose(theirs.position, mine.position, atol=1e-6)

    def test_a_run_reports_it(self, tmp_path: Path) -> None:
        scene = as_given(pipeline_of(small()), tmp_path)
        scene.save(tmp_path / "scene.toml")
        result = wf.run(Scene.load(tmp_path / "scene.toml"), tmp_path / "out")
        table = json.loads((result.folder / "result.json").read_text())
        assert table["airflow"]["rung"] == "given"
        assert "mesh" not in table["seconds"]
        assert (result.folder / "report.html").stat().st_size > 10_000
        sources = {part["source"]: part for part in table["budget"][0]["parts"]}
        assert sources["airflow-model"]["how"] == "unknown"

    def test_nothing_is_kept_of_it_but_numbers(self, tmp_path: Path) -> None:
        """What its dictionaries say, code too, is neither run nor copied."""
        scene = as_given(pipeline_of(small()), tmp_path)
        for name in ("system/controlDict", "constant/fvOptions"):
            with (tmp_path / "case" / name).open("a") as stream:
                stream.write(f'x #calc "system(\\"touch {tmp_path}/ran\\")";\nlibs ("/x/evil.so");\n')
        given = Pipeline(scene, make_plan(scene))
        assert np.isfinite(given.field[1].velocity).all()
        kept = {path.name for path in given.air.in_case.solution[1].rglob("*") if path.is_file()}
        assert kept == {"airflow.json", "manifest.json", "seconds.json"}
        assert not (tmp_path / "ran").exists()

    def test_a_new_solution_is_measured_anew(self, tmp_path: Path) -> None:
        scene = as_given(pipeline_of(small()), tmp_path)
        first = Pipeline(scene, make_plan(scene)).air.in_case.solution[0]
        assert Pipeline(scene, make_plan(scene)).air.in_case.solution[0] == first
        latest = max((p for p in (tmp_path / "case").iterdir() if p.name.isdigit()), key=lambda p: int(p.name))
        latest.rename(latest.with_name(str(int(latest.name) + 1)))
        (latest.with_name(str(int(latest.name) + 1)) / "p").touch()
        text = (tmp_path / "case" / "constant" / "transportProperties").read_text()
        (tmp_path / "case" / "constant" / "transportProperties").write_text(text + "// changed")
        assert Pipeline(scene, make_plan(scene)).air.in_case.solution[0] != first

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"body__rhombus__width": 0.052}, "air.case has a wall at x = "),
            ({"body__two": {"shape": "circle", "width": 0.02, "at": [0.1, 0.0]}}, "where body.two has a corner"),
            (
                {"channel__width": 0.4},
                "channel.width = 0.4 m reaches beyond the mesh of air.case, x from -0.15 to 0.15",
            ),
            ({"channel__top": 0.9}, "channel.top = 0.9 m reaches beyond the mesh of air.case, y from"),
            ({"air__direction": "up"}, "the air of air.case does not enter and leave that way"),
            ({"air__speed": 0.3}, "air.speed = 0.3 m/s, but 0.2 m/s enter in air.case"),
            ({"air__viscosity": 2e-5}, "but air.case has 0.0005 Pa s at this density"),
        ],
    )
    def test_a_case_of_another_scene_is_refused(self, tmp_path: Path, change: dict[str, Any], message: str) -> None:
        scene = as_given(pipeline_of(small()), tmp_path, **change)
        with pytest.raises(SceneError) as caught:
            _ = Pipeline(scene, make_plan(scene)).airflow
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_all_of_its_times_or_their_mean(self, tmp_path: Path) -> None:
        scene = as_given(pipeline_of(small()), tmp_path)
        latest = max((p for p in (tmp_path / "case").iterdir() if p.name.isdigit()), key=lambda p: int(p.name))
        for path in (tmp_path / "case").iterdir():
            if path.name.isdigit() and path.name not in ("0", latest.name):
                shutil.rmtree(path)
        shutil.copytree(latest, latest.with_name(str(int(latest.name) + 3)))  # the same air, 3 s later
        one = Pipeline(scene, make_plan(scene))
        whole, mean = (scene.replace({"air.time": time}) for time in ("all", "mean"))
        moving, still = (Pipeline(changed, make_plan(changed)) for changed in (whole, mean))
        np.testing.assert_array_equal(moving.field[1].times, [0.0, 3.0])
        np.testing.assert_allclose(moving.field[1].velocity[1], one.field[1].velocity)
        np.testing.assert_allclose(still.field[1].velocity, one.field[1].velocity)
        assert moving.airflow.cd.value == pytest.approx(one.airflow.cd.value)
        assert moving.tracks().fates["wheat"]["binned"] == 64

    def test_other_rungs_do_not_go_with_it(self, tmp_path: Path) -> None:
        scene = as_given(pipeline_of(small()), tmp_path)
        with pytest.raises(SceneError, match=r"rung = 'standard': air.case gives the airflow"):
            make_plan(scene, rung="standard")


def test_a_case_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"air.case = 'none': no OpenFOAM mesh"):
        small(air={"case": "none"})
    mesh = tmp_path / "case" / "constant" / "polyMesh"
    mesh.mkdir(parents=True)
    (mesh / "boundary").write_text("")
    with pytest.raises(SceneError, match="no solved time in"):
        small(air={"case": str(tmp_path / "case")})
    with pytest.raises(SceneError, match="give case as well"):
        small(air__time="all")


@pytest.mark.parametrize(
    ("inlet", "found"),
    [
        ("type fixedValue; value uniform (0 -5 0);", {"speed": 5.0, "direction": "down"}),
        ("type fixedValue; value uniform (0 2.5e-1 0);", {"speed": 0.25, "direction": "up"}),
        ("type fixedValue; value nonuniform List<vector> 2((0 1 0) (0 2 0));", {}),
    ],
)
def test_what_a_case_says_of_its_air(tmp_path: Path, inlet: str, found: dict[str, Any]) -> None:
    (tmp_path / "200").mkdir()
    (tmp_path / "constant").mkdir()
    stream = "side { type fixedValue; value uniform (1 0 0); }"
    text = f"internalField uniform (0 0 0);\nboundaryField {{ in {{ {inlet} }} {stream} wall {{ type noSlip; }} }}"
    (tmp_path / "200" / "U").write_text(text)
    (tmp_path / "constant" / "transportProperties").write_text("nu  nu [ 0 2 -1 0 0 0 0 ] 1.5e-05;")
    assert air_of(tmp_path) == {**found, "nu": 1.5e-5}


QUICK = {("rhombus", 10, 0.5), ("prism", 80, 0.5)}
RANGE = [
    pytest.param(*case, marks=[] if case in QUICK else pytest.mark.slow)
    for case in itertools.product(("rhombus", "prism"), (10, 45, 80), (0.02, 0.3, 0.5))
]


@pytest.mark.parametrize(("shape", "slope", "blockage"), RANGE)
class TestRange:
    """Slope angle 10 to 80 degrees, blockage 2 to 50 %: from the mesh to the landings."""

    pytestmark = pytest.mark.openfoam

    def test_from_mesh_to_landings(self, shape: str, slope: float, blockage: float) -> None:
        width = 0.05
        channel = width / blockage
        end = max(4 * width, width * math.tan(math.radians(slope)))
        scene = small(
            body={"one": {"shape": shape, "width": width, "slope_angle": math.radians(slope)}},
            channel={"width": channel, "top": end, "bottom": -end},
            air={"speed": 5.0},
            bin={"floor": {"from": -channel / 2, "to": channel / 2}},
            numerics__mesh_scale=2.5,
        )
        pipeline = pipeline_of(scene)
        airflow = pipeline.airflow
        assert airflow.cells < 6000
        assert abs(airflow.mass_error) < 1e-4
        assert 0.05 < airflow.cd.value * (1 - blockage) ** 2 < 3.0
        tracked = pipeline.tracks()
        for name, fates in tracked.fates.items():
            assert fates["stopped"] == fates["airborne"] == 0
            assert fates["binned"] + fates["resting"] + fates["escaped"] == 64
            assert np.isfinite(tracked.landings[name].position).all()


CALM = {"dispersion": False}
SPEED = "fraction.wheat.terminal_velocity"
LIGHT, HEAVY = 0, 1  # the scene's bins


@pytest.fixture(scope="module")
def aspirator() -> Scene:
    return shipped("aspirator", {"feed.count": 1024})


def flown(scene: Scene, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Terminal velocity in the scene's air (n,), bin (n,) and fate (n,) of a fraction's granules in calm air."""
    plan = make_plan(scene, force=CALM)
    feed, pipeline = feedstock(scene, plan, name, 0.0), Pipeline(scene, plan)
    tracks = Flight(scene, plan, pipeline.air.realisations, 1e-4).fly(name, feed.granules)
    air, grains = scene.air, feed.granules
    settling = terminal_velocity(
        grains.diameter, grains.density, air.density, air.viscosity,
        law=plan.fractions[name].drag,
        sphericity=scene.fraction[name].roundness, drag_scale=grains.drag_scale,
    )  # fmt: skip
    return settling, tracks.line, tracks.fate


@pytest.mark.parametrize(("name", "speed"), [("wheat", 7.3), ("straw", 3.5), ("internodes", 3.4)])
def test_a_granule_is_carried_over_where_its_terminal_velocity_is_below_the_air_speed(
    aspirator: Scene, name: str, speed: float
) -> None:
    settling, line, fate = flown(aspirator.replace({"air.speed": speed}), name)
    slack = 2e-3 if "buoyancy" not in make_plan(aspirator, force=CALM).fractions[name].forces else 1e-12
    decided = np.abs(settling / speed - 1.0) > max(slack, 1e-4)  # the others may hang in the air to the end
    assert decided.mean() > 0.95
    assert np.array_equal(line[decided] == LIGHT, settling[decided] < speed)
    assert np.array_equal(line[decided] == HEAVY, settling[decided] > speed)
    assert 0.1 < np.mean(settling < speed) < 0.9
    assert set(np.unique(fate)) <= {Fate.BINNED, Fate.AIRBORNE}


@pytest.mark.parametrize("share", [0.99, 0.999, 1.001, 1.01])
def test_granules_of_almost_the_airs_speed_still_end_where_they_belong(aspirator: Scene, share: float) -> None:
    """Within 1 % they need seconds; what differs by less than a ten thousandth may hang in the air."""
    scene = aspirator.replace({"fraction.wheat.terminal_velocity": share * 6.0})
    settling, line, _ = flown(scene, "wheat")
    np.testing.assert_allclose(settling, share * 6.0, rtol=1e-9)
    assert np.all(line == (LIGHT if share < 1.0 else HEAVY))


def test_the_momentum_of_the_fall_carries_light_grain_into_a_short_leg(aspirator: Scene) -> None:
    """A granule of the air's speed sinks by int v dv / (g (F(U + v) / F(U) - 1)), F the drag, before it turns: some
    8 % more than (U^2 / g) ln(1 + v0 / 2U), since the drag law's F grows a little less than with the square.
    """
    v = np.linspace(0.0, np.sqrt(2 * 9.81 * 0.1), 20_001)
    v = 0.5 * (v[1:] + v[:-1])
    factor, scale = drag_laws["brown-lawler"].factor, 1.204 * 3.88e-3 / 1.825e-5
    drag = factor((7.3 + v) * scale, 1.0) * (7.3 + v) / (factor(np.array([7.3 * scale]), 1.0) * 7.3)
    depth = float(np.sum(v / (9.81 * (drag - 1.0))) * (v[1] - v[0]))
    assert depth == pytest.approx(7.3**2 / 9.81 * np.log1p(1.4 / (2 * 7.3)), rel=0.1)
    for leg, place in ((0.985 * depth, HEAVY), (1.005 * depth, LIGHT)):
        changes = {"feed.height": 0.1, "air.speed": 7.3, SPEED: 7.3 * 0.9998, "channel.bottom": -leg}
        line = flown(aspirator.replace(changes), "wheat")[1]
        assert np.all(line == place), leg


def test_what_hangs_in_the_air_is_counted_elsewhere_and_said(aspirator: Scene, tmp_path: Path) -> None:
    hanging = aspirator.replace({"fraction.wheat.terminal_velocity": 6.0 * (1.0 + 1e-9), "feed.count": 32})
    result = wf.run(hanging, tmp_path, force=CALM, until="tracks")
    assert result.table["fates"]["wheat"]["airborne"] == 32
    assert any("they count as elsewhere" in line for line in result.table["warnings"])
    assert any("still in the air" in line for line in result.table["warnings"])


def test_the_shipped_scene_runs_whole_and_solves_nothing(aspirator: Scene, tmp_path: Path) -> None:
    result = wf.run(aspirator.replace({"feed.count": 256}), tmp_path)  # as it is, but for a short slab
    table = json.loads((tmp_path / "result.json").read_text())
    assert "NaN" not in json.dumps(table)
    assert table["airflow"]["verdict"] == "uniform"
    assert table["airflow"]["flow_rate"] == pytest.approx(6.0 * 0.2)
    assert table["airflow"]["cd"] is None
    assert {"mesh", "airflow"}.isdisjoint(table["seconds"])
    assert table["plan"]["unit"] == "channel widths"
    assert (tmp_path / "report.html").exists()
    assert not (tmp_path / "figures" / "pressure.png").exists()
    assert result.share("wheat", "heavy")[0] == 1.0  # 6 m/s lies in the published window of 4.85 to 7.04 m/s
    assert result.share("straw", "light")[0] > 0.99
    unknown = {part["source"] for row in table["budget"] for part in row["parts"] if part["how"] == "unknown"}
    assert unknown == {"airflow-model"}
    assert table["slab"]["replicates"] >= 4  # a dense curtain: granules meet
    assert table["slab"]["meetings"]["straw"] > 0.1
    assert not [p for row in table["budget"] for p in row["parts"] if p["source"] == "collisions"]


@pytest.mark.parametrize(
    ("spread", "cdf"),
    [
        ({"distribution": "uniform", "low": 7.04, "high": 7.74}, lambda u: (u - 7.04) / 0.70),
        ({"distribution": "normal", "mean": 7.3, "std": 0.25}, lambda _: 0.5),
        ({"distribution": "lognormal", "median": 7.3, "geometric_std": 1.04}, lambda _: 0.5),
    ],
)
def test_the_distribution_that_goes_in_comes_out(aspirator: Scene, spread: dict, cdf) -> None:  # type: ignore[no-untyped-def]
    """Whatever the sizes: each granule's own terminal velocity is the one drawn, and independent of its size."""
    sizes = {"distribution": "normal", "mean": "3.88 mm", "std": "0.3 mm"}
    scene = aspirator.replace(
        {"fraction.wheat.terminal_velocity": spread, "fraction.wheat.size": sizes, "air.speed": 7.3}
    )
    plan = make_plan(scene, force=CALM)
    shares = separate(scene, Pipeline(scene, plan).tracks().landings).fractions["wheat"]
    assert shares["light"].low - 2e-3 <= cdf(7.3) <= shares["light"].high + 2e-3
    grains = feedstock(scene, plan, "wheat", 0.0).granules
    settling = terminal_velocity(grains.diameter, grains.density, 1.204, 1.825e-5, drag_scale=grains.drag_scale)
    p = (np.arange(1024) + 0.5) / 1024
    wanted = scene.fraction["wheat"].settling(p)
    assert wanted is not None
    np.testing.assert_allclose(np.interp(np.sort(settling), wanted, p), p, atol=0.01)
    assert abs(np.corrcoef(settling, grains.diameter)[0, 1]) < 0.05
    assert plan.fractions["wheat"].terminal_velocity == pytest.approx(float(np.median(wanted)), rel=1e-4)


def test_other_fractions_keep_their_granules_when_one_gets_a_spread(aspirator: Scene) -> None:
    one = aspirator.replace({"fraction.wheat.terminal_velocity": 7.3})
    grains = [feedstock(s, make_plan(s), "straw", 0.0).granules for s in (aspirator, one)]
    assert np.array_equal(grains[0].drag_scale, grains[1].drag_scale)


def test_parabolic_air_is_plane_poiseuille_flow(aspirator: Scene) -> None:
    scene = aspirator.replace({"channel.walls": "no-slip", "air.profile": "parabolic", "air.direction": "down"})
    field, air = duct_field(scene, turbulent=False), scene.air
    x = np.linspace(-0.0999, 0.0999, 301)
    velocity = field.sample(np.stack([x, np.full(301, 0.1)], axis=1))[0]
    np.testing.assert_allclose(velocity[:, 1], -1.5 * 6.0 * (1 - (x / 0.1) ** 2), atol=6.0 * 1.5 / 64**2)
    assert np.mean(velocity[:, 1]) == pytest.approx(-6.0, rel=5e-3)
    drop = Pipeline(scene, make_plan(scene)).airflow.pressure_drop
    assert drop == pytest.approx(2 * air.viscosity * (6.0 * 6.0 / 0.2) * 1.0 / 0.2)  # wall shear 6 mu U / W, two walls
    assert any("turbulent" in line for line in make_plan(scene).warnings)


def test_a_streams_turbulence_decays_as_its_equations_say() -> None:
    """dk/dt = -epsilon by finite differences, and t^-1.087 far downstream."""
    t = np.linspace(0.0, 0.5, 2001)
    k, epsilon = decaying(0.135, 48.0, t)
    np.testing.assert_allclose(np.gradient(k, t)[1:-1], -epsilon[1:-1], rtol=2e-4)
    far = decaying(0.135, 48.0, np.array([1e3, 1e4]))[0]
    assert np.log10(far[1] / far[0]) == pytest.approx(-0.09 / 0.0828, rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"channel.walls": "no-slip"}, "parabolic"),
        ({"air.profile": "parabolic"}, "no-slip"),
        ({"feed.mode": "injected"}, "no body to meet"),
        ({"feed.level": "2 m"}, "feed.level"),
        ({"vibration.frequency": 30.0, "vibration.gamma": 2.0}, "vibrate"),
        ({"numerics.rung": "draft"}, "nothing to solve"),
        ({"feed.direction": "-80 deg"}, "direction and scatter go with speed"),
        ({"feed.scatter": "1 deg"}, "direction and scatter go with speed"),
        ({SPEED: -1.0}, r"fraction.wheat.terminal_velocity = -1.0: .* \(allowed: >= 1e-06 m/s and <= 100 m/s\)"),
        ({"fraction.wheat.terminal_velocity.high": 7.0}, "low = 7.04 must be below high = 7"),
        ({SPEED: {"distribution": "unifrom", "low": 1, "high": 2}}, "did you mean 'uniform'"),
        ({SPEED: {"distribution": "uniform", "mean": 7.0}}, "lacks low, high and has no mean"),
        ({SPEED: {"distribution": "normal", "mean": 25.0, "std": 1}}, "times a sphere's"),
    ],
)  # fmt: skip
def test_what_does_not_go_without_a_body_is_refused_in_one_line(aspirator: Scene, changes: dict, words: str) -> None:
    with pytest.raises(SceneError, match=words) as refused:
        make_plan(aspirator.replace(changes))
    assert "\n" not in str(refused.value)


def test_level_and_direction_are_for_channels_without_a_body(cases: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["plan", str(cases / "rhombus.toml"), "--set", "feed.level=0.1"]) == 2
    assert "feed.level: for a channel without a body" in capsys.readouterr().err


def test_granules_slid_in_fly_as_projectiles(aspirator: Scene) -> None:
    """In a vacuum: from the level with the speed and direction given, onto the floor where the parabola says."""
    tables = aspirator.tables()
    del tables["air"], tables["feed"]["height"]
    tables["feed"] |= {"speed": 0.5, "direction": 0.0, "width": 0.02, "position": -0.05}
    scene = Scene.parse(tables)
    feed = feedstock(scene, make_plan(scene), "wheat", 0.0)
    tracks = Flight(scene, make_plan(scene), Realisations(None), 1e-6).fly("wheat", feed.granules[:64])
    fall = np.sqrt(2 * 0.4 / 9.81)
    free = tracks.impacts == 0
    assert free.any()
    np.testing.assert_allclose(tracks.position[free, 0], feed.granules.position[:64][free, 0] + 0.5 * fall, atol=1e-6)


def test_a_belt_throws_granules_about_its_direction(aspirator: Scene) -> None:
    """By the rms angle given, at the speed given, along the whole belt alike; a Sobol set has it to 1 %."""
    tables = aspirator.tables()
    del tables["feed"]["height"]
    tables["feed"] |= {"speed": 0.5, "direction": math.radians(-30.0), "scatter": math.radians(1.5), "width": 0.02}
    scene = Scene.parse(tables)
    grains = feedstock(scene, make_plan(scene), "wheat", 0.0).granules
    angle = np.degrees(np.arctan2(grains.velocity[:, 1], grains.velocity[:, 0])) + 30.0
    assert np.mean(angle) == pytest.approx(0.0, abs=0.02)
    assert np.std(angle) == pytest.approx(1.5, rel=0.01)
    assert np.linalg.norm(grains.velocity, axis=1) == pytest.approx(0.5)
    assert abs(np.corrcoef(angle, grains.position[:, 0])[0, 1]) < 0.05
    straight = scene.replace({"feed.scatter": 0.0})
    same = feedstock(straight, make_plan(straight), "wheat", 0.0).granules
    assert np.array_equal(same.position, grains.position)
