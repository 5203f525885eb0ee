"""A stage's key covers all the code that computes it: the import closure, read from the sources."""

import re
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import wakeflow
from wakeflow import Scene
from wakeflow.core import sources
from wakeflow.pipeline.analytic import duct_field
from wakeflow.pipeline.realisations import Realisations
from wakeflow.pipeline.tracks import Flight
from wakeflow.planning.make import make_plan
from wakeflow.planning.stages import stages

CODE = {name: stages[name].code for name in stages if stages[name].code}
STAGES = {**CODE, "kernel": ("wakeflow.tracking.kernel.loop",)}


SOME = 6  # modules of a stage that are touched: its key reads all of them each time


@pytest.fixture
def copied(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of the sources that may be edited; keys are made of it."""
    root = tmp_path / "wakeflow"
    shutil.copytree(sources.PACKAGE, root, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(sources, "PACKAGE", root)
    sources.code_key.cache_clear()
    yield root
    sources.code_key.cache_clear()


@pytest.mark.parametrize("stage", STAGES)
def test_touching_any_module_of_the_closure_changes_the_key(stage: str, copied: Path) -> None:
    before = sources.code_key(*STAGES[stage])
    closure = sources.closure(*STAGES[stage])
    assert set(STAGES[stage]) <= closure
    for module in sorted(closure)[:: max(1, len(closure) // SOME)]:  # other ones for every stage
        base = copied.joinpath(*module.split(".")[1:])
        path = base / "__init__.py" if base.is_dir() else base.with_suffix(".py")
        text = path.read_text()
        path.write_text(f"{text}# touched\n")
        sources.code_key.cache_clear()
        assert sources.code_key(*STAGES[stage]) != before, module
        path.write_text(text)
    sources.code_key.cache_clear()
    assert sources.code_key(*STAGES[stage]) == before


def test_what_no_stage_runs_leaves_its_key_alone(copied: Path) -> None:
    before = sources.code_key(*CODE["airflow"])
    for name in ("cli/run.py", "pipeline/tracks.py"):
        (copied / name).write_text("")
    sources.code_key.cache_clear()
    assert sources.code_key(*CODE["airflow"]) == before


def test_data_files_of_the_funnel_enter_its_key(copied: Path) -> None:
    before = sources.code_key(*CODE["funnel"])
    (copied / "funnel" / "settle.liggghts").write_text("")
    sources.code_key.cache_clear()
    assert sources.code_key(*CODE["funnel"]) != before


def _ran(work: Callable[[], object]) -> set[str]:
    """Modules of the package whose code runs in ``work``."""
    ran: set[str] = set()

    def note(frame: FrameType, event: str, argument: Any) -> None:
        ran.add(frame.f_globals.get("__name__", ""))

    sys.setprofile(note)
    try:
        work()
    finally:
        sys.setprofile(None)
    return {module for module in ran if module.startswith("wakeflow.")}


def test_modules_that_run_while_granules_fly_stand_in_the_closure(cases: Path, tmp_path: Path) -> None:
    scene = Scene.load(cases / "vacuum.toml").replace({"feed.count": 16})
    flight = Flight(scene, make_plan(scene), Realisations(None), 1e-4)
    own = _ran(lambda: flight.fly_all(tmp_path, drawn=True))
    assert {"wakeflow.pipeline.tracks", "wakeflow.planning.plan", "wakeflow.laws.collision"} <= own
    assert own <= sources.closure(*CODE["tracks"])


def test_modules_that_run_while_a_duct_is_made_stand_in_the_closure(cases: Path) -> None:
    scene = Scene.load(cases / "aspirator.toml")
    own = _ran(lambda: duct_field(scene, turbulent=True))
    assert {"wakeflow.pipeline.analytic", "wakeflow.field.flow"} <= own
    assert own <= sources.closure(*CODE["duct"])


def test_every_stage_that_a_key_names_is_listed() -> None:
    folder = sources.PACKAGE / "pipeline"
    named = {name for path in folder.glob("*.py") for name in re.findall(r'code_of\("([^"]+)"\)', path.read_text())}
    assert named == set(CODE) - {"funnel"}


def test_a_name_that_is_no_module_is_refused() -> None:
    with pytest.raises(ModuleNotFoundError, match="nowhere is no module of wakeflow"):
        sources.closure("wakeflow.nowhere")


def test_what_a_package_registers_as_it_is_imported_counts() -> None:
    tracks = sources.closure(*CODE["tracks"])
    assert {"wakeflow.laws.forces.basic", "wakeflow.laws.forces.lift"} <= tracks


def test_names_of_a_package_lead_to_their_modules_only() -> None:
    assert "wakeflow.field.flow" in sources.closure("wakeflow.field")
    assert "wakeflow.foam.solver" not in sources.closure("wakeflow.foam.read")
    assert Path(wakeflow.__file__).parent == sources.PACKAGE
