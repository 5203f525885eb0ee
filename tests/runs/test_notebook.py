"""Progress in a notebook: one bar that is drawn over itself, in a kernel only, unless a listener hears instead."""

from pathlib import Path
from typing import Any

import pytest

import wakeflow as wf
from support import CASES, shipped
from wakeflow.pipeline.cache import silent
from wakeflow.runs import progress

display = pytest.importorskip("IPython.display")


class Cell:
    """What stands below a cell, as IPython is asked to show it."""

    def __init__(self) -> None:
        self.shown: list[str] = []

    def display(self, page: Any, *, display_id: bool) -> "Cell":
        assert display_id
        assert not self.shown  # once; afterwards it is drawn over
        self.update(page)
        return self

    def update(self, page: Any) -> None:
        self.shown.append(page.data)


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch) -> Cell:
    made = Cell()
    monkeypatch.setattr(progress, "_in_notebook", lambda: True)
    monkeypatch.setattr(display, "display", made.display)
    return made


def test_a_run_shows_a_bar_that_fills(cell: Cell, tmp_path: Path) -> None:
    wf.run(shipped("vacuum", {"feed.count": 32}), tmp_path)
    assert all(page.startswith("<progress") for page in cell.shown)
    parts = [float(page.split('value="')[1].split('"')[0]) for page in cell.shown]
    assert parts == sorted(parts)
    assert "stage" in cell.shown[0]
    assert "report: done" in cell.shown[-1]


def test_a_listener_of_the_caller_hears_instead(cell: Cell, tmp_path: Path) -> None:
    stages: list[str] = []
    wf.run(shipped("vacuum", {"feed.count": 32}), tmp_path, listener=lambda stage, text: stages.append(stage))
    assert "report" in stages
    assert not cell.shown


def test_nothing_is_shown_in_a_script() -> None:
    assert not progress._in_notebook()
    assert progress.heard(None)[0] is silent


@pytest.mark.slow
def test_a_kernel_shows_the_bar_the_table_and_a_picture(tmp_path: Path) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    cells = [
        f"import wakeflow as wf\nresult = wf.run({str(CASES / 'vacuum.toml')!r}, 'here')\nresult",
        "axes = result.plot.tracks()",
    ]
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source) for source in cells])
    nbclient.NotebookClient(book, timeout=600, resources={"metadata": {"path": tmp_path}}).execute()
    answer, picture = ([output["data"] for output in cell.outputs if "data" in output] for cell in book.cells)
    told = [str(data.get("text/html", "")) for data in answer]
    assert [page.split()[0].split(">")[0] for page in told] == ["<progress", "<table"]
    assert any("image/png" in data for data in picture)
