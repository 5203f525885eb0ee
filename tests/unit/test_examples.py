"""Every fenced block of every page runs, and what docstrings show; so do the scripts that make families of scenes.

The word behind a fence says what a block is: ``python`` is a script, ``sh`` what is typed, ``toml`` a scene, a part of
one, a sweep, a search or materials, ``csv`` trays; ``text`` is what a program prints. A second word is the test that
runs the blocks of that page in their order.
"""

import doctest
import re
import shlex
import tomllib
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import labyrinths
import prisms
import pytest
import rhombi

import wakeflow as wf
from pages import PAGES, Block, blocks, parse_command, tried
from proofs.studies.__main__ import app as studies
from support import CASES, ROOT, shipped
from wakeflow.extras.search.designs import refuse_void
from wakeflow.extras.search.task import read_search_file
from wakeflow.many.variant import read_sweep_file
from wakeflow.scene.changes import flat
from wakeflow.scene.measured import read_trays
from wakeflow.scene.scene_tables import SceneTables
from wakeflow.scene.schema import described
from wakeflow.scene.uncertainty import with_uncertainty_table

SMALL = {  # instead of the minutes of a page: a trickle of granules that neither meet nor load the air
    "numerics.rung": "draft", "numerics.mesh_scale": 3.0, "feed.count": 64, "feed.rate": "0.5 kg/hour",
}  # fmt: skip
AIRFLOW = re.compile(r"wf\.run\(|Pipeline\(")  # what computes one
SOURCES = ROOT / "src"
WITH_EXAMPLES = [
    ".".join(path.relative_to(SOURCES).with_suffix("").parts)
    for path in sorted(SOURCES.rglob("*.py"))
    if ">>> " in path.read_text()
]


def _python(block: Block, folder: Path) -> None:
    """A script, in a folder with the cases and the runs that it names."""
    with tried(block.body):
        pass


def _sh(block: Block, folder: Path) -> None:
    """What is typed: commands of the program parse, and scripts are there; of other programs nothing is known."""
    for line in block.body.splitlines():
        for command in re.split(r" && ", line):
            words = shlex.split(command, comments=True)
            if not words:
                continue
            program = words[0].removeprefix(".venv/bin/")
            if program == "wakeflow":
                parse_command(command.removeprefix(".venv/bin/").removeprefix("wakeflow "))
            elif program == "python" and words[1].endswith("studies"):
                parse_command(shlex.join(words[2:]), studies)
            elif program in ("python", "sh"):
                scripts = [word for word in words[1:] if "/" in word and not word.startswith("-")]
                assert scripts
                assert all((ROOT / script).exists() for script in scripts)


def _toml(block: Block, folder: Path) -> None:
    """A whole scene, search or sweep is read, and a search is none that could only end void; of a part of a scene its
    keys are there; other tables are those of a material.
    """
    given = with_uncertainty_table(tomllib.loads(block.body))
    for path in CASES.glob("*.toml"):
        (folder / path.name).write_text(path.read_text())
    file = folder / "page.toml"
    file.write_text(block.body)
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


def _csv(block: Block, folder: Path) -> None:
    file = folder / "trays.csv"
    file.write_text(block.body)
    assert read_trays(file)


def _text(block: Block, folder: Path) -> None:
    assert block.body.strip()


TAKEN_AS: dict[str, Callable[[Block, Path], None]] = {
    "python": _python, "sh": _sh, "toml": _toml, "csv": _csv, "text": _text,
}  # fmt: skip
SHOWN = [
    pytest.param(
        block,
        id=f"{page.stem}-{number}-{block.info or 'nothing'}".replace(" ", "-"),
        marks=[pytest.mark.openfoam] if block.info == "python" and AIRFLOW.search(block.body) else [],
    )
    for page in PAGES
    for number, block in enumerate(blocks(page), 1)
]


@pytest.fixture(scope="session")
def run_of_a_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run of the shipped rhombus, in air at rest, which needs no solver."""
    scene = shipped("rhombus", {"air.speed": 0.0, "feed.count": 64, "feed.rate": "0.5 kg/hour"})
    return wf.run(scene, tmp_path_factory.mktemp("page") / "rhombus").folder


@pytest.mark.usefixtures("no_screen")
@pytest.mark.parametrize("block", SHOWN)
def test_a_block_is_what_it_says(
    block: Block, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest
) -> None:
    language, _, test = block.info.partition(" ")
    if test:
        (file,) = (ROOT / "tests").rglob(f"{test}.py")
        assert block.page.name in file.read_text()
        return
    load = wf.Scene.load

    def small(path: Path | str, changes: dict[str, Any] | None = None) -> wf.Scene:
        scene = load(path, changes or {})
        return scene if scene.air is None else scene.replace(SMALL)

    if language == "python":
        (tmp_path / "cases").symlink_to(CASES)
        if 'load("runs/' in block.body:
            (tmp_path / "runs").symlink_to(request.getfixturevalue("run_of_a_page").parent)
        monkeypatch.setattr(wf.Scene, "load", small)
    monkeypatch.chdir(tmp_path)
    TAKEN_AS[language](block, tmp_path)


def test_pages_show_no_code_without_a_fence() -> None:
    """Indented lines are formulas: neither commands, nor tables of a scene, nor statements."""
    for page in PAGES:
        text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
        for line in re.findall(r"^ {4,}(\S.*)", text, re.MULTILINE):
            assert not re.match(r"wakeflow |import |from |def |\[\w|\w+ = [\"{\[]", line), f"{page.name}: {line}"


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
