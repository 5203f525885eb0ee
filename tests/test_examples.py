"""What README, docs and docstrings show in Python runs; so do the scripts that make families of scenes."""

import doctest
import re
import tomllib
from importlib import import_module
from pathlib import Path
from typing import Any

import labyrinths
import prisms
import pytest
import rhombi

import wakeflow as wf
from support import CASES, DOCS, ROOT
from wakeflow.extras.search.designs import refuse_void
from wakeflow.extras.search.task import read_search_file
from wakeflow.many.variant import read_sweep_file
from wakeflow.scene.changes import flat
from wakeflow.scene.schema import described
from wakeflow.scene.uncertainty import with_uncertainty_table
from wakeflow.scene.whole import SceneTables

BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SMALL = {  # instead of the minutes of a page: a trickle of granules that neither meet nor load the air
    "numerics.rung": "draft", "numerics.mesh_scale": 3.0, "feed.count": 64, "feed.rate": "0.5 kg/hour",
}  # fmt: skip
# tests/test_extending.py, tests/test_tutorial.py, tests/report/test_plot.py (a finished run, read again)
ELSEWHERE = {DOCS / f"{page}.md" for page in ("extending", "tutorial", "results")}
PAGES = [ROOT / "README.md", *sorted(set(DOCS.glob("*.md")) - ELSEWHERE)]
AIRFLOW = re.compile(r"wf\.run\(|Pipeline\(")  # what computes one
SHOWN = [
    pytest.param(code, id=f"{page.name}-{number}", marks=[pytest.mark.openfoam] if AIRFLOW.search(code) else [])
    for page in PAGES
    for number, code in enumerate(BLOCK.findall(page.read_text()), 1)
]
SOURCES = ROOT / "src"
WITH_EXAMPLES = [
    ".".join(path.relative_to(SOURCES).with_suffix("").parts)
    for path in sorted(SOURCES.rglob("*.py"))
    if ">>> " in path.read_text()
]


@pytest.mark.parametrize("code", SHOWN)
def test_python_on_a_page_runs(code: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load = wf.Scene.load

    def small(path: Path | str, changes: dict[str, Any] | None = None) -> wf.Scene:
        scene = load(path, changes or {})
        return scene if scene.air is None else scene.replace(SMALL)

    monkeypatch.setattr(wf.Scene, "load", small)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cases").symlink_to(CASES)
    exec(compile(code, "a page", "exec"), {"wf": wf})


TOML = re.compile(r"^```toml\n(.*?)^```$", re.MULTILINE | re.DOTALL)
TABLES = [
    pytest.param(text, id=f"{page.name}-{number}")
    for page in [ROOT / "README.md", *sorted(DOCS.glob("*.md"))]
    for number, text in enumerate(TOML.findall(page.read_text()), 1)
]


@pytest.mark.parametrize("text", TABLES)
def test_tables_on_a_page_are_what_the_program_takes(text: str, tmp_path: Path) -> None:
    """A whole scene, search or sweep is read, and a search is none that could only end void; of a part of a scene its
    keys are there; other tables are those of a material.
    """
    given = with_uncertainty_table(tomllib.loads(text))
    for path in CASES.glob("*.toml"):
        (tmp_path / path.name).write_text(path.read_text())
    file = tmp_path / "page.toml"
    file.write_text(text)
    if "search" in given:
        refuse_void(read_search_file(file))
    elif "sweep" in given:
        assert list(read_sweep_file(file))
    elif {"channel", "feed", "fraction", "bin"} <= given.keys():
        assert wf.Scene.load(file)
    elif given.keys() & SceneTables.model_fields.keys():
        keys = [key for key in flat(given) if not key.startswith("uncertainty.")]
        unknown = [key for key in keys if not described(tuple(key.split(".")), given)]
        assert not unknown
    else:
        assert all({"confidence", "source"} <= table.keys() for table in given.values())


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_in_docstrings_hold(name: str) -> None:
    done = doctest.testmod(import_module(name), report=True)
    assert done.attempted > 0
    assert done.failed == 0


MADE = {"labyrinths", "prisms", "rhombi"}


def test_every_generator_is_tried() -> None:
    assert {path.stem for path in CASES.glob("*.py")} == MADE


def test_rhombi_keep_their_bins_beside_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = rhombi.main(tmp_path, [50.0], [25.0])
    assert not found.failed
    scene = wf.Scene.load(tmp_path / "rhombus-50-25.toml")
    assert scene.width == pytest.approx(0.025)
    assert scene.bin["middle"].to == pytest.approx(0.04)
    assert capsys.readouterr().out.count("% of the wheat") == 1


def test_prisms_are_written_and_planned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    prisms.main(tmp_path, [45.0])
    assert {path.stem for path in tmp_path.glob("*.toml")} == {"prism-up-45", "prism-down-45"}
    assert wf.Scene.load(tmp_path / "prism-down-45.toml").body["prism"].apex == "down"
    assert capsys.readouterr().out.count("about") == 2


def test_labyrinths_have_their_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = labyrinths.main(tmp_path, [2])
    assert not found.failed
    assert len(wf.Scene.load(tmp_path / "labyrinth-2.toml").body) == 3
    assert "labyrinth-2: recovered" in capsys.readouterr().out
