"""docs/tutorial.md: every line of code runs in order, as it stands or without its airflow; the page is a notebook."""

import ast
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from pages import blocks
from support import DOCS
from wakeflow.cli import main

PAGE = DOCS / "tutorial.md"
BLOCK = re.compile(r"^```(python|sh) test_tutorial\n(.*?)^```", re.MULTILINE | re.DOTALL)
STEPS = 10
pytestmark = pytest.mark.usefixtures("no_screen")


def _walked(text: str) -> dict[str, Any]:
    """The names that the page's code leaves, run in the current folder; commands end well."""
    names: dict[str, Any] = {}
    for language, body in BLOCK.findall(text):
        if language == "python":
            exec(compile(ast.parse(body), str(PAGE), "exec"), names)
            continue
        for line in filter(None, body.splitlines()):
            word, *arguments = shlex.split(line)
            assert word == "wakeflow"
            assert main(arguments) == 0, line
    return names


def _check(names: dict[str, Any], folder: Path) -> None:
    """What the page says that there is."""
    value, low, high = (names[name] for name in ("value", "low", "high"))
    assert 0.0 <= low <= value <= high <= 1.0
    assert value > 0.1  # wheat lands outside, where it is meant to
    assert not names["swept"].failed
    assert names["best"].possible
    assert names["best"].purity.value == pytest.approx(0.95, abs=0.05)
    for file in ("my.toml", "machine.png", "runs/my-plan.png", "runs/my/report.html", "runs/my/sensitivity.csv"):
        assert (folder / file).stat().st_size > 0


def test_the_page_has_ten_steps_with_code() -> None:
    steps = re.split(r"^## (\d+)\. ", PAGE.read_text(), flags=re.MULTILINE)[1:]
    assert [int(number) for number in steps[::2]] == list(range(1, STEPS + 1))
    assert all(BLOCK.search(text) for text in steps[1::2])


def test_every_line_runs_without_an_airflow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    text = PAGE.read_text()
    for line, instead in (
        ('"numerics.rung": "draft"', '"numerics.rung": "none"'),
        ('"feed.count": 256', '"feed.count": 64'),
        ('air.speed": "4 m/s"', 'air.speed": "4.5 m/s"'),
    ):
        assert text.count(line) == 1
        text = text.replace(line, instead)
    monkeypatch.chdir(tmp_path)
    _check(_walked(text), tmp_path)


@pytest.mark.slow
@pytest.mark.openfoam
def test_every_line_runs_as_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    _check(_walked(PAGE.read_text()), tmp_path)


def test_the_page_is_a_notebook() -> None:
    jupytext = pytest.importorskip("jupytext")
    book = jupytext.reads(PAGE.read_text(), fmt="md")
    code = [cell.source for cell in book.cells if cell.cell_type == "code"]
    shown = [block.body.strip() for block in blocks(PAGE)]
    assert [cell.removeprefix("%%sh\n").strip() for cell in code] == shown
