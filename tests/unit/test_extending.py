"""What the examples of docs/extending.md add is used the public way, and removed again."""

import contextlib
import io
import math
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from pages import blocks, tried
from proofs.problems.exact import exact_problems, fly
from support import DOCS
from wakeflow.answer.budget.source import budget_sources
from wakeflow.cli import main
from wakeflow.laws.impaction import Cylinder
from wakeflow.laws.turbulence import turbulence_models
from wakeflow.planning.stages import stages
from wakeflow.planning.uniform_fall import front_of
from wakeflow.show.asked_pictures import draw_all
from wakeflow.show.figures import figures

Check = Callable[[Path, Path, dict[str, Any]], None]  # cases, a folder, names of the example
CHECKS: dict[str, list[Check]] = defaultdict(list)
EXAMPLES = {block.heading: block.body for block in blocks(DOCS / "extending.md")}
LAWS = "Laws, shapes and materials"


def example(heading: str) -> Callable[[Check], None]:
    """The decorated function uses what the example under ``heading`` adds."""
    return CHECKS[heading].append


def _thrown(**changes: Any) -> wf.Granules:
    """One granule on its way down onto y = 0."""
    options: dict[str, Any] = {"diameter": 1e-3, "density": 1000.0} | changes
    return wf.Granules(np.array([[0.0, 0.1]]), np.array([[1.0, -1.0]]), **options)


def _still_air() -> wf.FlowField:
    corners = np.array([(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)])
    return wf.FlowField.from_arrays(corners, np.array([(0, 1, 2), (0, 2, 3)]), np.zeros((4, 2)))


def _vacuum(cases: Path, **changes: Any) -> wf.Scene:
    return wf.Scene.load(cases / "vacuum.toml").replace({"feed.count": 32, **changes})


@example(LAWS)
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    at = wf.track(_still_air(), _thrown(), until=0.05, drag="abraham").position
    other = wf.track(_still_air(), _thrown(), until=0.05).position
    assert 0.0 < np.linalg.norm(at - other) < 0.2 * np.linalg.norm(at - [[0.0, 0.1]])  # nearly the same drag
    scene = wf.Scene.load(cases / "rhombus.toml").replace({"fraction.chaff.drag": "abraham"})
    assert wf.plan(scene).fractions["chaff"].drag == "abraham"


@example("A force")
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    pull = np.add(names["PUSH"], (0.0, -9.81))
    for air in (None, _still_air()):
        at = wf.track(air, _thrown(), until=0.05, forces=("gravity", "electric-field")).position
        assert at == pytest.approx(np.array([[0.05, 0.05]]) + 0.5 * 0.05**2 * pull)
    plan = wf.plan(wf.Scene.load(cases / "rhombus.toml"))
    assert all(fraction.bounds["electric-field"] > 0.0 for fraction in plan.fractions.values())
    assert all("electric-field" in fraction.forces for fraction in plan.fractions.values())


@example(LAWS)
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    size = {"distribution": "log-uniform", "low": "1 mm", "high": "4 mm"}
    scene = _vacuum(cases, **{"fraction.soft.size": size})
    assert scene.fraction["soft"].diameters(np.array([0.5])) == pytest.approx(2e-3)
    assert wf.chain(scene).share("soft", "near")[0] > 0.0


@example(LAWS)
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    scene = _vacuum(cases, **{"feed.profile": "cosine"})
    assert scene.feed.places(np.array([0.0, 0.5, 1.0])) == pytest.approx([2.5e-3, 12.5e-3, 22.5e-3])
    assert scene.feed.crowding == pytest.approx(np.pi**2 / 8, rel=1e-3)


@example(LAWS)
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    law = wf.Restitution("exponential", value=0.8, at=2.0)
    floor = np.array([(-1.0, -0.1), (1.0, -0.1), (1.0, 0.0), (-1.0, 0.0)])
    grains = _thrown(restitution=law, friction=0.0)
    flown = wf.track(None, grains, until=0.09, bodies=(floor,), gravity=(0.0, 0.0))
    assert flown.velocity[0, 1] == pytest.approx(-1.0)  # not there yet
    flown = wf.track(None, grains, until=0.12, bodies=(floor,), gravity=(0.0, 0.0))
    assert flown.velocity[0, 1] == pytest.approx(0.8 * np.exp(-0.5), rel=1e-6)
    table = {"law": "exponential", "value": 0.8, "at": "2 m/s"}
    assert _vacuum(cases, **{"fraction.hard.restitution": table}).fraction["hard"].restitution is not None


@example(LAWS)
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    assert _vacuum(cases, **{"fraction.hard.impact": "coin"}).fraction["hard"].inertia == 0.25


@example(LAWS)
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    scene = wf.Scene.load(cases / "rhombus.toml").replace({"fraction.dust.material": "steel-shot"})
    assert scene.fraction["dust"].properties.density == 7850.0
    assert any("low confidence" in warning for warning in wf.plan(scene).warnings)


@example(LAWS)
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    body = {"shape": "gable", "width": "50 mm", "slope_angle": "45 deg", "height": "10 mm"}
    scene = wf.Scene.load(cases / "rhombus.toml").replace({"body.rhombus": body, "feed.count": 32})
    assert wf.plan(scene, rung="none").airflow.kind == "none"
    result = wf.run(scene, folder / "gable", rung="none")
    shares = result.separation["fractions"]["wheat"]
    assert sum(row["value"] for row in shares.values()) == pytest.approx(1.0)


@example(LAWS)
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    octagon = [[0.025 * np.cos(a), 0.025 * np.sin(a)] for a in np.pi / 4 * np.arange(8)]
    body = {"shape": "polygon", "points": octagon}
    scene = wf.Scene.load(cases / "rhombus.toml").replace({"body.rhombus": body})
    assert isinstance(front_of(scene), Cylinder)


@example(LAWS)
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    plan = wf.plan(wf.Scene.load(cases / "rhombus.toml"))
    assert 0.0 < plan.fractions["wheat"].bounds["electrostatic"] < 0.04
    assert ("electrostatic", "wheat") in {(term.name, term.fraction) for term in plan.left_out}


@example("A kind of picture")
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    landings = {name: SimpleNamespace(x=np.linspace(0.0, 0.1, 5)) for name in ("soft", "hard")}
    scene = SimpleNamespace(fraction=landings, picture={"where": names["Heaps"](kind="heaps", fractions=["hard"])})
    drawn = draw_all(folder, SimpleNamespace(scene=scene, landings=landings))["where"]  # type: ignore[arg-type]
    assert drawn.numbers["mean_x_m"] == {"hard": pytest.approx(0.05)}
    assert all((folder / file).stat().st_size > 0 for file in drawn.files)


@example("An exact problem")
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    setting, answer = exact_problems["coasting"].at(6)
    assert np.allclose(fly(setting, 1e-3).position, answer.position, atol=1e-12)


@example("A rung, a kind of airflow")
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    scene, still = (
        wf.Scene.load(cases / "rhombus.toml", {"feed.count": 64}),
        {"basset-history": False, "collisions": False},
    )
    assert wf.plan(scene, rung="coarse", force=still).airflow.scales == (2.0,)
    result = wf.run(scene, folder, rung="potential", force=still, report=False)
    for name in scene.fraction:
        assert sum(result.share(name, place)[0] for place in [*scene.bin, "elsewhere"]) == pytest.approx(1.0)
    assert result.table["airflow"]["verdict"] == "potential flow"
    unknown = {part["source"] for part in result.table["budget"][0]["parts"] if part["how"] == "unknown"}
    assert {"mesh", "airflow-model"} <= unknown


@example("A command")
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main(["gamma", str(cases / "rhombus.toml"), "--times", "2"]) == 0
    strength = wf.Scene.load(cases / "rhombus.toml").vibration.strength  # type: ignore[union-attr]
    assert float(out.getvalue()) == pytest.approx(2 * strength, rel=0.01)
    with contextlib.redirect_stderr(io.StringIO()) as refused:
        assert main(["gamma", str(cases / "aspirator.toml")]) == 2
    assert "nothing vibrates" in refused.getvalue()


@example("A turbulence model")
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    # tests/unit/air/test_turbulence_models.py solves an airflow with it
    assert turbulence_models["realizableKE"].turbulent


@example("A source of the budget")
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    assert budget_sources["coarser-steps"].place == 70
    result = wf.run(_vacuum(cases), folder, report=False)
    parts = [part for row in result.budget if row.quantity.startswith("share.") for part in row.parts]
    errors = [part.error for part in parts if part.source == "coarser-steps"]
    assert errors
    assert all(error is not None and math.isfinite(error) for error in errors)


@example("A stage")
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    (cost,) = [stage for stage in wf.plan(_vacuum(cases)).stages if stage.name == "weights"]
    assert cost.seconds == 2000.0
    assert stages["weights"].heading == "scales"


@example("A standard figure")
def _(cases: Path, folder: Path, names: dict[str, Any]) -> None:
    landings = {name: SimpleNamespace(bin=np.zeros(5)) for name in ("soft", "hard")}
    figures["sizes"].draw(folder / "sizes.png", SimpleNamespace(landings=landings))  # type: ignore[arg-type]
    assert (folder / "sizes.png").stat().st_size > 500


def test_every_example_is_used() -> None:
    assert set(EXAMPLES) == set(CHECKS)


@pytest.mark.parametrize("heading", list(EXAMPLES))
def test_the_example_serves(heading: str, cases: Path, tmp_path: Path) -> None:
    with tried(EXAMPLES[heading]) as names:
        for check in CHECKS[heading]:
            check(cases, tmp_path, names)
