"""Pictures that a scene asks for, and the paper's figures as scenes."""

import csv
import html
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from support import ALONE, CASES
from wakeflow.core.errors import SceneError
from wakeflow.core.geometry import distance_to
from wakeflow.extras.pictures.maps import mass_flux
from wakeflow.flight.feed.feedstock import feedstock
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene, picture_tables
from wakeflow.show.asked_pictures import pictures
from wakeflow.show.figures import flights as figures
from wakeflow.show.moving import Path2D, body_displacement

GRAVITY = 9.81
PAPER = CASES / "paper"
COARSE: dict[str, Any] = {"feed.count": 1024}
AIR = {**COARSE, "numerics.mesh_scale": 3.0, "fraction.dust.size": "40 um"}
SCENES = [
    *(pytest.param(name, COARSE, id=name) for name in ("fig2", "fig3", "fig4")),
    pytest.param("fig6", COARSE, id="fig6"),
    pytest.param("fig7", {**AIR, "picture.fig7-flows.granules": 64}, id="fig7", marks=pytest.mark.openfoam),
    *(
        pytest.param(name, AIR, id=name, marks=[pytest.mark.openfoam, pytest.mark.slow])
        for name in ("air-stream", "barrier")
    ),
]


def scene_of(name: str, changes: dict[str, Any] | None = None) -> Scene:
    return Scene.load(PAPER / f"{name}.toml", changes)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as stream:
        return list(csv.DictReader(stream))


def test_every_shipped_scene_is_run_here() -> None:
    assert {str(param.id) for param in SCENES} == {path.stem for path in PAPER.glob("*.toml")}


@pytest.mark.parametrize(("name", "changes"), SCENES)
def test_a_scene_of_the_paper_leaves_its_pictures_and_their_data(
    name: str, changes: dict[str, Any], tmp_path: Path
) -> None:
    scene = scene_of(name, changes)
    result = wf.run(scene, tmp_path, force=ALONE)
    assert set(result.table["pictures"]) == set(scene.picture)
    page = (tmp_path / "report.html").read_text()
    for picture in result.table["pictures"].values():
        assert html.escape(picture["text"]) in page
        for file in picture["files"]:
            assert (tmp_path / "figures" / file).stat().st_size > 500, file
    CHECKS[name.rstrip("234") if name != "fig6" else name](result, tmp_path / "figures")
    again = wf.run(scene, tmp_path, force=ALONE)  # nothing is drawn again
    assert again.table["pictures"] == result.table["pictures"]


def check_curves(result: wf.Result, folder: Path) -> None:
    """The chosen granules against eq. (2) and free fall: 153 and 57 mm, a factor of 2.7 (the paper: "even three")."""
    (name,) = result.table["pictures"]
    numbers = result.table["pictures"][name]["numbers"]
    rows = rows_of(folder / f"{name}.csv")
    for fraction, (restitution, friction) in {"soft": (0.1, 0.6), "hard": (0.5, 0.3)}.items():
        found = numbers["fractions"][fraction]["chosen"]
        assert found["body_speed"] == pytest.approx(0.3, abs=1e-3)
        slope, met = math.pi / 4, found["body_speed"]
        fall = found["vx"] / float(wf.impact(slope, 1.0, 0.0, restitution, friction).velocity[0]) - met
        # it meets the body within 0.7 mm of the middle of its motion, on a slope 0.2 mm wide
        assert abs(fall**2 / (2 * GRAVITY) - 0.1) < 0.9e-3
        ux, uy = wf.impact(slope, fall, met, restitution, friction).velocity
        time = (uy + math.sqrt(uy**2 + 2 * GRAVITY * 0.1)) / GRAVITY
        assert (found["time"], found["x"], found["vx"]) == pytest.approx((time, ux * time, ux), rel=1e-6)
        assert found["x"] == pytest.approx({"soft": 0.0572, "hard": 0.1530}[fraction], rel=5e-3)
        chosen = [row for row in rows if (row["fraction"], row["granule"]) == (fraction, "chosen")]
        t, x, y, vx, vy = (
            np.array([float(row[key]) for row in chosen])
            for key in ("time (s)", "x (m)", "y (m)", "vx (m/s)", "vy (m/s)")
        )
        np.testing.assert_allclose(x, vx[0] * t, atol=1e-9)
        np.testing.assert_allclose(vx, vx[0], rtol=1e-6)
        np.testing.assert_allclose(y, vy[0] * t - GRAVITY * t**2 / 2, atol=1e-9)
        assert y[-1] == pytest.approx(-0.1, abs=1e-7)
    assert numbers["ratio"] == pytest.approx(0.1530 / 0.0572, rel=6e-3)  # V0 of either within 0.35 %
    spread = numbers["fractions"]["hard"]["x"]
    assert spread["low"] < 0.6 * spread["high"]  # the phase matters, and the picture says so


def check_motion(result: wf.Result, folder: Path) -> None:
    """Both begin at rest; the hard granules are down long before the soft ones; none enters the moving body."""
    scene, rows = Scene.parse(result.table["scene"]), rows_of(folder / "fig6.csv")
    first = [row for row in rows if float(row["time (s)"]) == 0.0]
    assert {row["fraction"] for row in first} == {"soft", "hard"}
    assert all(float(row["vx (m/s)"]) == float(row["vy (m/s)"]) == 0.0 for row in first)
    lasted = {row["fraction"]: float(row["time (s)"]) for row in rows}
    assert 0 < 4 * lasted["hard"] < lasted["soft"]
    outline, pipeline = scene.body["prism"].outline(), Pipeline(scene, make_plan(scene, force=ALONE))
    shown = pipeline.shown(scene.picture["fig6"])
    for path in (Path2D.of(track) for part in shown.values() for track in part):
        off = path.position - body_displacement(scene, path.time)
        assert len(off) > 10
        assert distance_to(off, outline).min() > path.diameter / 2 - 1e-8


def check_air(result: wf.Result, folder: Path) -> None:
    name = next(iter(result.table["pictures"]))
    air = rows_of(folder / f"{name}.csv")
    down, cp = (np.array([float(row[key]) for row in air]) for key in ("air vy (m/s)", "Cp"))
    assert np.median(down) == pytest.approx(-5.0, rel=0.1)
    assert cp.min() < -0.5 < 0.5 < cp.max()
    through = result.table["pictures"][f"{name}-flows"]["numbers"]["through"]
    if name == "fig7":  # the light fractions pass the zone, the heavy one flies past it
        assert through["dust"]["suction"] > 0.9 > 0.2 > through["wheat"]["suction"]
    flows = rows_of(folder / f"{name}-flows.csv")
    x, y = (np.unique([float(row[key]) for row in flows]) for key in ("x (m)", "y (m)"))
    flux = np.array([float(row["wheat (kg/(m^2 s))"]) for row in flows]).reshape(len(y), len(x))
    through_levels = flux.sum(axis=1) * (x[1] - x[0]) * 0.3
    # below the body all of the wheat falls, slanting: through a level goes its rate, over the cosine of the slant
    below = through_levels[(y > -0.08) & (y < -0.05)] / (0.9 * 500 / 3600)
    assert (below > 0.98).all()
    assert (below < 1.4).all()


CHECKS = {
    "fig": check_curves, "fig6": check_motion, "fig7": check_air, "air-stream": check_air,
    "barrier": check_air,
}  # fmt: skip


def test_pictures_do_not_touch_the_tracks() -> None:
    keys = set()
    for name in ("fig2", "fig3", "fig4"):
        scene = scene_of(name)
        keys.add(Pipeline(scene, make_plan(scene)).tracks_key)
    bare = scene_of("fig2").tables()
    del bare["picture"]
    scene = Scene.parse(bare)
    assert keys == {Pipeline(scene, make_plan(scene)).tracks_key}


def test_every_kind_has_keys_and_is_drawn() -> None:
    assert set(pictures) == set(picture_tables())


def test_a_recorded_path_is_exact_in_free_flight_and_right_up_to_a_bounce() -> None:
    t = np.array([0.0, 0.1, 0.25])
    velocity = np.array([[1.0, 0.0], [0.5, 0.4], [0.5, 0.4 - 0.15 * GRAVITY]])  # thrown off at 0.1 s
    position = np.array([[0.0, 0.0], [0.1, -GRAVITY * 0.005], [0.175, -GRAVITY * 0.005 + 0.06 - GRAVITY * 0.15**2 / 2]])
    arriving = np.array([velocity[0], (1.0, -0.1 * GRAVITY), velocity[2]])
    path = Path2D(t, position, velocity, arriving, 1e-3)
    (before, after), (v_before, v_after) = path.at(np.array([0.1 - 1e-9, 0.1 + 1e-9]))
    np.testing.assert_allclose(before, after, atol=1e-8)
    np.testing.assert_allclose(v_before, (1.0, -0.1 * GRAVITY), atol=1e-7)
    np.testing.assert_allclose(v_after, (0.5, 0.4), atol=1e-7)
    where, speed = path.at(np.array([0.2, 9.0]))
    np.testing.assert_allclose(where[0], (0.15, position[1, 1] + 0.04 - GRAVITY * 0.005), atol=1e-12)
    np.testing.assert_allclose(speed[1], velocity[2], atol=1e-12)
    level = position[1, 1] - 0.02
    root = (0.4 + math.sqrt(0.16 + 2 * GRAVITY * 0.02)) / GRAVITY
    assert path.falls_to(level, 1) == pytest.approx(0.1 + root, abs=1e-12)
    assert math.isinf(path.falls_to(-10.0, 1))


def test_the_mass_flux_through_every_level_is_the_rate() -> None:
    x0 = np.linspace(-0.09, 0.09, 37)
    t = np.linspace(0.0, 0.2, 5)
    down = np.tile([0.0, -1.0], (5, 1))
    steep = [Path2D(t, np.stack([x + 0 * t, 0.1 - t], axis=1), down, down, 1e-3) for x in x0]
    x, y = np.linspace(-0.1, 0.1, 21), np.linspace(-0.1, 0.1, 11)
    flux = mass_flux(steep, rate=2.0, depth=0.5, x=x, y=y)
    np.testing.assert_allclose((flux * np.diff(x) * 0.5).sum(axis=1), 2.0, rtol=1e-9)


def test_resting_granules_lie_on_the_body_at_its_lower_dead_point() -> None:
    scene = scene_of("fig6", COARSE)
    feed = feedstock(scene, make_plan(scene), "hard", 0.0)
    shift = body_displacement(scene, feed.granules.time)
    np.testing.assert_allclose(shift, np.tile(-scene.motion[0], (len(shift), 1)), atol=1e-15)
    gap = distance_to(feed.granules.position - shift, scene.body["prism"].outline())
    np.testing.assert_allclose(gap, feed.granules.diameter / 2, atol=1e-12)
    assert not feed.injected.any()
    assert not feed.granules.velocity.any()


def test_without_vibration_friction_alone_decides_who_stays(tmp_path: Path) -> None:
    tables = scene_of("fig6", {"feed.count": 16}).tables()
    del tables["vibration"], tables["picture"]
    result = wf.run(Scene.parse(tables), tmp_path, until="tracks", force={"air-loading": False})
    fates = result.table["fates"]
    assert fates["soft"]["resting"] == 16  # 0.6 > tan 30 deg = 0.577
    assert fates["hard"]["binned"] == 16


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"picture.fig2.kind": "curvs"}, r"picture\.fig2\.kind: 'curvs' is unknown; did you mean 'curves'\?"),
        ({"picture.new.x": "time"}, r"picture\.new\.kind: missing \(known: curves, streamlines"),
        ({"picture.new.kind": "animation"}, r"'animation' is unknown \(wakeflow animate films a finished run\)"),
        ({"picture.fig2.frames": 3}, r"picture\.fig2\.frames: unknown key.*known: kind, caption"),
        ({"picture.fig2.z": "time"}, r"picture\.fig2\.z: unknown key"),
        ({"picture.fig2.y": "height"}, r"picture\.fig2\.y = 'height'"),
        ({"picture.fig2.y": "time"}, r"picture\.fig2: x and y are both time"),
        ({"picture.fig2.drop": -1.0}, r"picture\.fig2\.drop = -1\.0.*allowed: > 0.* m"),
        ({"picture.fig2.origin": "scene"}, "drop is counted from the separation"),
        ({"picture.fig2.fractions": ["sotf"]}, r"no fraction 'sotf'; did you mean 'soft'\?"),
        ({"picture.fig2.body_speed": 0.4}, r"body_speed = 0\.4 m/s: the body rises by at most 0\.314 m/s"),
        ({"picture.air.kind": "streamlines"}, r"picture\.air: streamlines need an \[air\] table"),
        ({"picture.tracks.kind": "density"}, r"picture\.tracks: every run draws one of this name"),
        ({"feed.start": "resting"}, "take neither height nor speed"),
    ],
)  # fmt: skip
def test_a_wrong_picture_is_said_in_one_line(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError, match=message) as caught:
        scene_of("fig2", changes)
    assert "\n" not in str(caught.value)


def test_granules_must_rest_on_the_body() -> None:
    with pytest.raises(SceneError, match="granules lie from x = 24 mm to 32 mm, the body reaches from -30 mm to 30 mm"):
        scene_of("fig6", {"feed.position": "28 mm"})


def test_a_picture_with_a_body_speed_needs_injected_granules(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="impacts are resolved; a picture with body_speed needs"):
        wf.run(scene_of("fig2", {"feed.count": 16, "feed.mode": "resolved"}), tmp_path)


def test_secondary_streams_are_drawn_with_an_arrow_into_the_channel(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, kept = scene_of("air-stream"), []
    monkeypatch.setattr(figures, "save", lambda figure, path, data=None: kept.append(figure))
    figures.draw_tracks("unused", None, scene, {})
    arrows = {a.xyann[0]: a.xy[0] for a in kept[0].axes[0].texts if a.arrow_patch is not None and a.xyann[1] == -60.0}
    assert arrows.keys() == {-200.0, 200.0}
    assert arrows[-200.0] > -200.0
    assert arrows[200.0] < 200.0
    told = [a.get_text() for a in kept[0].axes[0].texts]
    assert {"left 3 m/s", "right 3 m/s"} <= set(told)
    plain = replace_inlets(scene)
    figures.draw_tracks("unused", None, plain, {})
    assert not [a for a in kept[1].axes[0].texts if "left" in a.get_text() and "m/s" in a.get_text()]


def replace_inlets(scene: Scene) -> Scene:
    tables = scene.tables()
    del tables["channel"]["inlet"]
    return Scene.parse(tables)


def test_resting_granules_on_a_measured_vibration_begin_where_it_stands_still_at_its_lowest() -> None:
    t = np.linspace(0.0, 0.08, 161)
    acceleration = 20.0 * np.sin(2 * np.pi * t / 0.08) + 9.0 * np.cos(4 * np.pi * t / 0.08 + 0.4)
    samples = {"time": t.tolist(), "acceleration": acceleration.tolist()}
    tables = scene_of("fig6", COARSE).tables()
    tables["vibration"] = {"samples": samples}
    scene = Scene.parse(tables)
    feed = feedstock(scene, make_plan(scene), "hard", 0.0)
    moments = np.linspace(0.0, 0.08, 20001)
    lowest = body_displacement(scene, moments)[:, 1].min()
    np.testing.assert_allclose(body_displacement(scene, feed.granules.time)[:, 1], lowest, atol=1e-9)
    shift = body_displacement(scene, feed.granules.time[:1] + np.array([-1e-6, 1e-6]))
    assert abs(shift[1, 1] - shift[0, 1]) / 2e-6 < 1e-4  # m/s: it stands still
    gap = distance_to(
        feed.granules.position - body_displacement(scene, feed.granules.time), scene.body["prism"].outline()
    )
    np.testing.assert_allclose(gap, feed.granules.diameter / 2, atol=1e-12)
