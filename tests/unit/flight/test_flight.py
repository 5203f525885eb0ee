"""From the feed to the landing: walls, ends, mirror images, what is kept, what is drawn of the unknown, and a film."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import wakeflow as wf
from support import shipped
from wakeflow.air.field import FlowField
from wakeflow.air.field.combined import varied
from wakeflow.air.kinds.airflow_kinds import Realisations
from wakeflow.answer.budget.inputs import UNKNOWN
from wakeflow.core.errors import SceneError
from wakeflow.extras.motion.film_stage import SINGLY, Film, flown_film
from wakeflow.flight.feed.feedstock import feedstock, samples
from wakeflow.flight.stages.fraction_flights import Flight, _second_half, bodies_and_walls, end_lines
from wakeflow.flight.stages.landings import load_tracked
from wakeflow.flight.stages.pipeline import InputRerun, Pipeline
from wakeflow.laws.restitution import Restitution
from wakeflow.planning.collisions import number_rates
from wakeflow.planning.plan import COMPARED, INPUT_SAMPLES, REPLICATES, SAME_AIR, replicate_size
from wakeflow.planning.terms import COLLISIONS
from wakeflow.planning.unknowns import FARTHEST, SIGMAS, unknown_kinds
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene


@pytest.fixture
def scene(cases: Path) -> Scene:
    return Scene.load(cases / "rhombus.toml", {"feed.count": 256})


def leaning(scene: Scene, speed: float = 1.0) -> FlowField:
    """A time-resolved airflow that blows to the right all the time, with that ``speed`` (m/s)."""
    half, low, high = scene.channel.width / 2, scene.channel.bottom, scene.channel.top
    corners = np.array([(-half, low), (half, low), (half, high), (-half, high)])
    wind = np.tile([speed, -5.0], (2, 4, 1))
    return FlowField.from_arrays(
        corners, [(0, 1, 2), (0, 2, 3)], wind, np.zeros((2, 4)), times=[0.0, 0.05], period=0.1, density=1.2
    )


def test_each_replicate_flies_half_in_the_mirror_image_of_a_time_resolved_airflow(scene: Scene, tmp_path: Path) -> None:
    plan = make_plan(scene, rung="standard", force={"dispersion": False})
    Flight(scene, plan, Realisations(leaning(scene)), 1e-4).fly_all(tmp_path, drawn=False)
    size = replicate_size(256)
    for name, landing in load_tracked(tmp_path, scene).landings.items():
        np.testing.assert_array_equal(landing.replicate, np.repeat(np.arange(REPLICATES), size))
        x = landing.position[:, 0].reshape(REPLICATES, 2, size // 2)
        right, left = x[:, 0].mean(), x[:, 1].mean()
        assert right > 5e-3
        assert left == pytest.approx(-right, abs=0.2 * right), name
        assert np.abs(x.mean(axis=(1, 2))).max() < 0.4 * right, name  # each is balanced: there are no two clusters


def test_the_halves_of_a_replicate_are_balanced_in_every_coordinate(scene: Scene) -> None:
    """Place, size, phase and period of release: in each quarter of its range, half of the granules are of either."""
    feed = feedstock(scene, make_plan(scene, rung="draft"), "chaff", 0.1, range(4))
    points, _ = samples("chaff", 256, scene.feed.seed, range(4))
    size = len(points) // 4
    other = _second_half(feed, size, range(4)).reshape(4, size)
    for replicate, coordinates in enumerate(points.reshape(4, size, 4)):
        for values in coordinates.T:
            in_quarter = other[replicate][np.argsort(values)].reshape(4, size // 4).sum(axis=1)
            assert in_quarter.tolist() == 4 * [size // 8]


def test_replicates_fly_in_the_realisations_of_the_airflow_in_turn(scene: Scene, tmp_path: Path) -> None:
    """Winds of three strengths: each replicate meets one of them and its mirror image; the fields are made one by one,
    and the answer of a comparison's few replicates is that of the same ones among all.
    """
    plan = make_plan(scene, rung="standard", force={"dispersion": False})
    made: list[float] = []

    def wind(speed: float) -> FlowField:
        made.append(speed)
        return leaning(scene, speed)

    others = (partial(wind, 2.0), partial(wind, 3.0))
    flight = Flight(scene, plan, Realisations(leaning(scene), others, cycles=2), 1e-4)
    flight.fly_all(tmp_path, drawn=True)
    assert made == [2.0, 3.0] * len(scene.fraction)
    replace(flight, replicates=COMPARED).fly_all(tmp_path / "few", drawn=False)
    few = load_tracked(tmp_path / "few", scene).landings
    for name, landing in load_tracked(tmp_path, scene).landings.items():
        np.testing.assert_array_equal(landing.realisation, landing.replicate % 3)
        size = replicate_size(256)
        x = landing.position[:, 0].reshape(REPLICATES, 2, size // 2)
        away = [np.mean(x[i::3, 0] - x[i::3, 1]) for i in range(3)]
        assert away == sorted(away), name
        np.testing.assert_allclose(np.bincount(landing.cycle), 2 * [8 * size], rtol=0.1)
        np.testing.assert_array_equal(few[name].position, landing.position[landing.replicate < COMPARED])


def test_realisations_have_one_period(scene: Scene, tmp_path: Path) -> None:
    plan = make_plan(scene, rung="standard", force={"dispersion": False})
    other = replace(leaning(scene), period=0.2)
    with pytest.raises(SceneError, match=r"realisation 1: its period is 0\.2 s"):
        Flight(scene, plan, Realisations(leaning(scene), (lambda: other,)), 1e-4).fly_all(tmp_path, drawn=False)


def test_a_landing_keeps_the_cycle_of_its_release(scene: Scene) -> None:
    airs = Realisations(leaning(scene), cycles=4)
    assert airs.cycle_of(np.array([0.0, 0.024, 0.026, 0.0999, 0.1, 1.051])).tolist() == [0, 0, 1, 3, 0, 2]
    steady = airs.mapped(FlowField.mean)
    assert steady.cycle_of(np.array([0.0, 1.0])).tolist() == [0, 0]
    assert Realisations(None).cycle_of(np.array([1.0])).tolist() == [0]


def test_an_unsymmetric_geometry_has_no_mirror_image(scene: Scene, tmp_path: Path) -> None:
    plan = make_plan(scene, rung="standard", force={"dispersion": False})
    plan = replace(plan, airflow=replace(plan.airflow, symmetric=False))
    Flight(scene, plan, Realisations(leaning(scene)), 1e-4).fly_all(tmp_path, drawn=False)
    for landing in load_tracked(tmp_path, scene).landings.values():
        assert landing.position[landing.replicate % 2 == 1, 0].mean() > 5e-3


def test_a_fraction_that_is_there_is_not_flown_again(scene: Scene, tmp_path: Path) -> None:
    told: list[str] = []
    plan = make_plan(scene, rung="standard", force={"dispersion": False})
    flight = Flight(scene, plan, Realisations(leaning(scene)), 1e-4, tell=told.append)
    flight.fly_all(tmp_path, drawn=False)
    (tmp_path / "chaff.npz").unlink()
    told.clear()
    flight.fly_all(tmp_path, drawn=False)
    assert {line.split(":")[0] for line in told} == {"chaff"}


def test_bins_open_the_walls_and_come_first_among_the_ends(scene: Scene) -> None:
    assert len(bodies_and_walls(scene)) == 3  # the body and two walls
    window = scene.replace({"bin.window": {"on": "left", "from": -0.1, "to": 0.0}})
    walls = bodies_and_walls(window)[1:]
    assert len(walls) == 3  # the left wall in two pieces
    left = sorted((w.outline[:, 1].min(), w.outline[:, 1].max()) for w in walls if w.outline[0, 0] < 0)
    assert left[0][1] == pytest.approx(-0.1)
    assert left[1][0] == pytest.approx(0.0)
    lines = end_lines(window)
    assert len(lines) == len(window.bin) + 2
    np.testing.assert_allclose(lines[list(window.bin).index("window")], [(-0.2, -0.1), (-0.2, 0.0)])
    assert lines[-2][0, 1] < scene.channel.bottom
    assert lines[-1][0, 1] > scene.channel.top


SPAN = 0.3  # s


def _film(scene: Scene, *, meet: bool) -> Film:
    return flown_film(Pipeline(scene, make_plan(scene, force={COLLISIONS: meet})), SPAN)


def _inside(film: Film, name: str) -> int:
    """Granules that were born in the time of the film."""
    begun = np.array([track["time"][0] for track in film.paths[name]])
    return int(((begun >= film.begin) & (begun < film.begin + SPAN)).sum())


@pytest.mark.parametrize("meet", [True, False])
def test_all_that_are_there_are_there(meet: bool) -> None:
    scene = shipped("vacuum", {"feed.rate": 0.2, "feed.count": 512})
    film = _film(scene, meet=meet)
    assert film.met == meet
    assert film.span == SPAN
    assert film.depth <= scene.feed.depth
    for name in scene.fraction:
        rate = number_rates(scene, name).sum() * film.depth / scene.feed.depth / film.one_in[name]
        assert abs(_inside(film, name) - rate * SPAN) < 5.0 * np.sqrt(rate * SPAN) + 1.0
        there = [int((t["time"][0] <= film.begin + SPAN / 2) & (film.begin + SPAN / 2 <= t["time"][-1]))
                 for t in film.paths[name]]  # fmt: skip
        assert 0 < sum(there) <= 2.0 * SINGLY or meet
        for track in film.paths[name]:
            assert track["time"][-1] > film.begin
            assert track["time"][0] < film.begin + SPAN


def test_a_film_is_flown_once() -> None:
    scene = shipped("vacuum", {"feed.rate": 0.2, "feed.count": 512})
    heard: list[tuple[str, str]] = []
    for _ in range(2):
        heard.clear()
        flown_film(Pipeline(scene, make_plan(scene), lambda stage, text: heard.append((stage, text))), SPAN)
    assert [text for stage, text in heard if stage == "film"] == ["done (from the cache)"]


EXACT = ("restitution", "friction", "size")


@pytest.fixture(scope="module")
def vacuum() -> wf.Scene:
    return shipped("vacuum", {"feed.count": 1024})


def _pipeline(scene: wf.Scene) -> Pipeline:
    return Pipeline(scene, make_plan(scene))


def _only(scene: wf.Scene, key: str, half: float) -> wf.Scene:
    """The scene of which nothing but the number at ``key`` is unknown."""
    exact = {f"uncertainty.fraction.{name}.{number}": 0 for name in scene.fraction for number in EXACT}
    known = exact | {f"uncertainty.feed.{number}": 0 for number in ("width", "position", "height")}
    return scene.replace({**known, f"uncertainty.{key}": half})


def test_nothing_is_flown_where_all_is_known(vacuum: wf.Scene) -> None:
    pipeline = _pipeline(_only(vacuum, "feed.width", 0.0))
    assert not list(UNKNOWN.fly(pipeline, pipeline.tracks()))


def test_the_range_is_that_of_the_scene_at_the_ends_of_the_interval(vacuum: wf.Scene) -> None:
    """One unknown: the response's range is what whole runs at the ends of its interval give."""
    half = 0.04
    scene = _only(vacuum, "fraction.hard.restitution", half)
    draws = _pipeline(scene).run(InputRerun())
    assert [one.key for one in draws.unknowns] == ["fraction.hard.restitution"]
    moved = np.mean((draws.varied["hard"].bin == 0) * 1.0 - (draws.own["hard"].bin == 0), axis=1)
    slope = float(np.polyfit(draws.z[:, 0], moved, 1)[0]) * SIGMAS
    ends = []
    for sign in (-1.0, 1.0):
        own_value = vacuum.fraction["hard"].properties.restitution
        other = vacuum.replace({"fraction.hard.restitution": own_value + sign * half})
        ends.append(_pipeline(other).tracks().landings["hard"].counts(len(scene.bin)).mean(axis=0)[0])
    assert slope == pytest.approx(0.5 * (ends[1] - ends[0]), rel=0.2)
    assert abs(slope) > 0.02  # it matters
    for column in ("bin", "position"):  # the other fraction flies as before
        np.testing.assert_array_equal(getattr(draws.varied["soft"], column), getattr(draws.own["soft"], column))


def test_the_air_has_fewer_draws_and_all_are_standard_normal() -> None:
    from support import shipped

    scene = shipped("rhombus", {"feed.count": 64})
    stage = InputRerun().stage(Pipeline(scene, make_plan(scene)))
    of_air = np.array([unknown_kinds[one.kind].of_air for one in stage.unknowns])
    air, rest = stage.design[:, of_air], stage.design[:, ~of_air]
    assert len(np.unique(air, axis=0)) == INPUT_SAMPLES // SAME_AIR
    assert len(np.unique(rest, axis=0)) == INPUT_SAMPLES
    np.testing.assert_allclose(stage.design.mean(axis=0), 0.0, atol=0.1)
    np.testing.assert_allclose(stage.design.std(axis=0), 1.0, atol=0.15)
    for part in (air, rest):  # by how much each slope's variance grows because the columns are not orthogonal
        draws, columns = np.unique(part, axis=0).shape
        by_chance = (draws - 1) / (draws - columns - 1)  # of independent normal columns, the mean
        assert np.linalg.inv(np.corrcoef(part, rowvar=False)).diagonal().max() < 1.5 * by_chance
    assert FARTHEST > 2.0


def test_a_faster_air_is_the_same_air_in_less_time() -> None:
    points = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    times, k = np.array([0.0, 0.5]), np.full((2, 4), 0.3)
    field = wf.FlowField.from_arrays(
        points, np.array([(0, 1, 2), (0, 2, 3)]), np.ones((2, 4, 2)), np.full((2, 4), 2.0), times, 1.0, k, 0.1 * k
    )
    faster = varied(field, speed=1.1)
    np.testing.assert_allclose(faster.velocity, 1.1)
    np.testing.assert_allclose(faster.pressure, 2.0 * 1.21)
    assert faster.period == pytest.approx(1.0 / 1.1)
    length = faster.k**1.5 / faster.dissipation
    np.testing.assert_allclose(length, 0.3**1.5 / 0.03)  # the eddies are as large
    longer = varied(field, lifetime=2.0, energy=4.0)
    np.testing.assert_allclose(longer.k, 1.2)
    # eddies of one size turn over with k^1/2, and each lasts twice as long
    np.testing.assert_allclose(longer.k / longer.dissipation, 2.0 * (0.3 / 0.03) / 2.0)
    np.testing.assert_allclose(varied(field, energy=4.0, entering=0.1).k, 0.2 + 4.0 * 0.1)  # a wake's own stays


@pytest.mark.parametrize(
    "law",
    [
        Restitution("constant", value=0.95),
        Restitution("power", value=0.5, at=1.0),
        Restitution("table", speeds=[0.1, 1.0], values=[0.9, 0.98]),
        Restitution("viscoelastic", value=0.9, at=0.5),
    ],
)
def test_a_law_of_restitution_shifts_by_what_was_measured(law: Restitution) -> None:
    speed = np.array([0.1, 1.0])
    lower, higher = law.shifted(-0.05)(speed), law.shifted(0.2)(speed)
    assert np.all(lower < law(speed))
    assert np.all(higher <= 1.0)
    assert np.all(higher >= law(speed))
