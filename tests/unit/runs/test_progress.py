"""How far a run is: stages done and under way, the time left; in a notebook one bar that is drawn over itself."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

import wakeflow as wf
from support import CASES, shipped
from wakeflow.core.quantities import duration
from wakeflow.planning.stage_cache import null_listener
from wakeflow.planning.stages import StageCost
from wakeflow.runs import progress as bars
from wakeflow.runs.progress import FROM_CACHE, RunProgress, live

STAGES = (
    StageCost("mesh", 2.0, "first"),
    StageCost("airflow", 60.0, "answer"),
    StageCost("tracks", 30.0, "after"),
    StageCost("report", 8.0, "after"),
)


@dataclass
class Clock:
    """A clock that goes when it is told to."""

    now: float = 0.0
    seen: list[float] = field(default_factory=list)

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def progress(clock: Clock) -> RunProgress:
    made = RunProgress(clock=clock)
    made.begin(STAGES, cores=2)
    return made


def test_at_the_beginning_everything_is_left(progress: RunProgress) -> None:
    assert (progress.number, progress.part) == (1, 0.0)
    assert progress.left == pytest.approx(102.0)


def test_a_stage_under_way_counts_by_its_time_until_it_is_overdue(progress: RunProgress, clock: Clock) -> None:
    progress.hear("mesh", "meshing")
    clock.now = 2.0
    progress.hear("mesh", "done (2.0 s)")
    progress.hear("airflow", "iteration 1")
    clock.now = 32.0
    assert progress.number == 2
    assert progress.left == pytest.approx(102.0 - 32.0)
    clock.now = 500.0
    assert progress.part == pytest.approx((2.0 + 57.0) / 102.0)


def test_each_kind_of_work_has_its_own_pace(progress: RunProgress, clock: Clock) -> None:
    """An airflow of twice its time says nothing of flights, but of the next airflow; so does one that is overdue."""
    progress.begin([*STAGES, StageCost("loaded-airflow", 20.0, "after", 2)], cores=2)
    progress.hear("airflow", "iteration 1")
    clock.now = 120.0
    slow = (120.0 + 20.0) / (60.0 + 20.0)  # what stands before both: 20 s
    assert progress.left == pytest.approx(2.0 + 3.0 * slow + 38.0 + 40.0 * slow + 2.0)
    progress.hear("airflow", "done (120.0 s)")
    progress.hear("mesh", "done (2.0 s)")
    assert progress.left == pytest.approx(38.0 + 40.0 * slow + 2.0)
    progress.hear("loaded-airflow", "iteration 1")
    clock.now += 10.0
    progress.hear("loaded-airflow", "done (10.0 s)")
    assert progress.left == pytest.approx(38.0 + 20.0 * (130.0 + 20.0) / (80.0 + 20.0) + 2.0)


def test_what_comes_from_the_cache_is_no_work(progress: RunProgress, clock: Clock) -> None:
    for stage in ("mesh", "airflow"):
        progress.hear(stage, FROM_CACHE)
    clock.now = 1.0
    assert len(progress.expected) == 2
    assert progress.number == 1
    assert progress.left == pytest.approx(41.0, abs=3.0)


def test_what_is_made_now_and_read_again_stays_done(progress: RunProgress) -> None:
    progress.hear("tracks", "done (3.0 s)")
    progress.hear("tracks", FROM_CACHE)
    assert progress.number == 2
    assert len(progress.expected) == 4


def test_the_time_left_that_is_told_grows_by_a_quarter_at_most(progress: RunProgress, clock: Clock) -> None:
    assert str(progress).endswith("about 2 min left")
    for name in ("mesh", "airflow"):
        progress.hear(name, "begun")
        clock.now += 20.0 * sum(one.seconds for one in STAGES if one.name == name)
        progress.hear(name, "done (now)")
    progress.expected = [*progress.expected, StageCost("second airflow", 600.0, "answer")]
    assert progress.left is not None
    assert progress.left > 1.25 * progress.least
    said = progress.least
    assert f"at least {duration(1.25 * said)} left" in str(progress)
    assert progress.least == said


def test_many_stages_from_the_cache_are_one_line() -> None:
    progress = RunProgress(expected=[StageCost(f"stage {i}", 1.0, "first") for i in range(27)])
    for one in tuple(progress.expected):
        progress.hear(one.name, FROM_CACHE)
    assert progress.from_cache == "27 stages from the cache"


def test_without_a_plan_nothing_is_promised() -> None:
    nothing = RunProgress()
    nothing.hear("verify", "problem 3 of 28")
    assert nothing.left is None
    assert str(nothing) == ""


def test_a_run_names_its_stages_as_its_plan_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, heard = shipped("vacuum", {"feed.count": 64}), []
    with live(enabled=True, as_json=True) as told:

        def listener(stage: str, text: str) -> None:
            heard.append(stage)
            told(stage, text)

        result = wf.run(scene, tmp_path, planned=told.planned, listener=listener)
    expected = {stage.name for stage in wf.plan(scene).stages}
    assert expected <= set(heard)
    assert expected - {"report"} == set(result.table["seconds"]) - {"compile", "drawings"}
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert {"stage", "text", "number", "of", "seconds_left"} == set(lines[0])
    assert lines[-1]["stage"] == "report"
    assert all(line["number"] <= line["of"] for line in lines)


def test_quiet_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with live(enabled=False) as told:
        told("mesh", "done (1.0 s)")
    assert capsys.readouterr() == ("", "")


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
    made, display = Cell(), pytest.importorskip("IPython.display")
    monkeypatch.setattr(bars, "_in_notebook", lambda: True)
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
    scene = shipped("vacuum", {"feed.count": 32})
    wf.run(scene, tmp_path, report=False, listener=lambda stage, text: stages.append(stage))
    assert "tracks" in stages
    assert not cell.shown


def test_nothing_is_shown_in_a_script() -> None:
    assert not bars._in_notebook()
    assert bars.as_listener(None)[0] is null_listener


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
