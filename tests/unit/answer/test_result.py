"""The answer's types: what they hold comes back byte for byte, and the page says what they hold."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from result_page import PAGE, page

import wakeflow as wf
from support import landings_in, shipped
from wakeflow.air.kinds.airflow_table import Airflow, GridStudy
from wakeflow.answer.notices import ENDINGS, _out_of_the_top, _unlanded, with_mesh_error
from wakeflow.answer.result import SCHEMA, Result, request_in
from wakeflow.answer.shares import BudgetPart, InputPart, weightiest
from wakeflow.core.errors import SceneError
from wakeflow.core.files import write_json
from wakeflow.core.graded import Grade
from wakeflow.core.number import Number
from wakeflow.core.record import from_json
from wakeflow.core.store import content_key
from wakeflow.flight import Fate
from wakeflow.planning.plan import Plan
from wakeflow.runs import report_again
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene
from wakeflow.show.screen import MAX_WARNINGS, warn
from wakeflow.show.words import BUDGET_COLUMNS, IMPACT_COLUMNS, SEPARATION_COLUMNS, holds, separation_cells


def tables_of(title: str) -> list[tuple[str, ...]]:
    """The rows of the table under a heading of the page, without its head."""
    (text,) = re.findall(rf"^#+ {re.escape(title)}\n(.*?)(?=^#|\Z)", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)
    lines = [line for line in text.splitlines() if line.startswith("| ")][1:]
    return [tuple(cell.strip() for cell in line.strip("|").split("|")) for line in lines]


def first_column(title: str) -> list[str]:
    return [name for row in tables_of(title) for name in _names(row[0])]


def _names(cell: str) -> list[str]:
    """What a cell names, each between backticks."""
    return cell.strip("`").split("`, `")


def test_a_finished_run_is_read_back_byte_for_byte(small_run: Result) -> None:
    text = (small_run.folder / "result.json").read_text()
    again = Result.load(small_run.folder)
    again.save()
    assert (small_run.folder / "result.json").read_text() == text
    table = json.loads(text)
    assert table.pop("sha256") == content_key(again.table)
    assert again.table == small_run.table == table
    assert again.share("soft", "near") == small_run.share("soft", "near")
    assert again.separation == small_run.table["separation"]
    assert again.landings == small_run.landings


def test_what_stands_against_an_answer_is_told_with_it(small_run: Result) -> None:
    assert (small_run.caveat, small_run.lacking) == ("", ())
    assert holds(small_run).startswith("The interval holds 95 %")

    void = replace(small_run, warnings=("beads jam; feed.rate below 2 kg/h",), grades=(Grade.VOID.value,))
    assert repr(void).endswith("vacuum: void>")
    assert holds(void).startswith("VOID")
    assert "beads jam" in holds(void)

    model = BudgetPart(source="airflow-model")  # of a size that nobody knows
    budget = tuple(replace(row, parts=(*row.parts, model)) for row in small_run.budget)
    lacking = replace(small_run, landings=replace(small_run.landings, budget=budget))
    assert repr(lacking).endswith("; without airflow-model>")
    assert "lacks airflow-model, whose size is not known; it takes numerics.rung = 'standard'" in holds(lacking)
    known = {row.quantity for row in budget}
    table = separation_cells(lacking, small_run.landings.separation)
    rows = [dict(zip(table.heads, row, strict=True)) for row in table.rows]
    told = {row["not in the interval"] for row in rows if f"share.{row['fraction']}.{row['bin']}" in known}
    assert told == {"airflow-model"}


def test_an_input_is_named_with_its_error_and_not_below_twice_that() -> None:
    """A square's relative error is twice its root's: an index of 0.4 +- 0.3 is a change of 12 +- 4.5 points."""
    known, vague = (InputPart(half=0.12, variance=0.4, error=error, rise=0.12) for error in (0.3, 0.5))
    assert known.uncertainty == pytest.approx(0.045)
    assert known.points == "12 (7.5 to 16)"
    small = InputPart(half=0.01, variance=0.05, error=0.01, rise=0.01)
    assert weightiest({"a": vague, "b": known, "c": small}) == [("b", known)]


def test_drag_holds_the_error_of_its_mesh() -> None:
    still = Number(2.053, 2.053, 2.053)
    study = GridStudy(
        2.053, 1.821, 2.284, quantity="cd", cells=(776, 360), values=(2.053, 1.964), order=None, kind="two-grid", why=""
    )
    assert with_mesh_error(Airflow(cd=still, grids=(study,))).cd == Number(2.053, 1.821, 2.284)
    assert with_mesh_error(Airflow(cd=still)).cd == still


def test_a_folder_without_a_run_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="holds no finished run; make one with: wakeflow run"):
        Result.load(tmp_path)
    (tmp_path / "result.json").write_text("{")
    with pytest.raises(SceneError, match=r"result.json is damaged; make it again with: wakeflow run"):
        Result.load(tmp_path)
    with pytest.raises(SceneError, match=r"is no run but holds some, .*: name "):
        Result.load(tmp_path.parent)
    with pytest.raises(SceneError, match="folder of a run = 3: needs a path, not int"):
        Result.load(3)  # type: ignore[arg-type]
    with pytest.raises(SceneError, match="is a file; name the folder"):
        Result.load(tmp_path / "result.json")
    (tmp_path / "result.json").write_text("[]")
    with pytest.raises(SceneError, match="is damaged"):
        Result.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"grades": None}, "grades: is null, must have a value"),
        ({"sparkle": 1}, "sparkle: is not known to this version"),
        ({"seconds": {"tracks": {"seconds": 1.0}}}, r"seconds\.tracks\.cached: is missing"),
    ],
)
def test_what_is_no_result_is_named(small_run: Result, change: dict[str, object], words: str) -> None:
    with pytest.raises(SceneError, match=words):
        Result.from_json(small_run.folder, {**small_run.table, **change})


def test_a_run_that_ended_early_has_no_shares(tmp_path: Path, cases: Path) -> None:
    scene = wf.Scene.load(cases / "vacuum.toml", {"feed.count": 256})
    result = wf.run(scene, tmp_path, until="tracks")
    assert result.flights is not None
    assert result.landings is None
    assert Result.load(tmp_path).to_json() == result.table
    with pytest.raises(SceneError, match="the run ended before them"):
        result.share("soft", "near")
    with pytest.raises(SceneError, match="without --until"):
        report_again(tmp_path)


def test_a_plan_is_read_back(cases: Path) -> None:
    for name in ("rhombus", "vacuum", "labyrinth"):
        table = make_plan(wf.Scene.load(cases / f"{name}.toml")).summary()
        assert from_json(Plan, table, "plan").summary() == table


@pytest.mark.parametrize("schema", [1, 2, SCHEMA + 1, None, "3"])
def test_a_result_of_another_version_is_refused_by_one_line(schema: object, small_run: Result, tmp_path: Path) -> None:
    """Which says how to make it anew: its scene and how it was asked for can still be read."""
    table = {**small_run.table, "schema": schema}
    write_json(tmp_path / "result.json", table | {"sha256": content_key(table)})
    words = r"result.json is of another version of wakeflow; make it again with: wakeflow run SCENE --out "
    for read in (lambda: Result.load(tmp_path), lambda: Result.from_json(tmp_path, table)):
        with pytest.raises(SceneError, match=words + re.escape(str(tmp_path))) as told:
            read()
        assert "\n" not in str(told.value)
    scene, asked = request_in(tmp_path)
    assert (scene, asked) == (small_run.scene, small_run.options)
    without = {key: value for key, value in small_run.table.items() if key != "schema"}
    with pytest.raises(SceneError, match=words):
        Result.from_json(tmp_path, without)


def test_the_page_says_what_the_types_hold() -> None:
    """Brought up to date by: python tests/unit/answer/result_page.py."""
    assert PAGE.read_text() == page()


def test_the_page_names_the_columns_of_the_files(small_run: Result) -> None:
    for name, columns_ in (("separation", SEPARATION_COLUMNS), ("budget", BUDGET_COLUMNS), ("impact", IMPACT_COLUMNS)):
        assert first_column(f"The columns of {name}.csv") == list(columns_)
        head = (small_run.folder / f"{name}.csv").read_text().splitlines()[0]
        for column in columns_:
            assert column in head


def test_the_page_names_the_arrays_of_granules_npz(small_run: Result) -> None:
    with np.load(small_run.folder / "granules.npz") as data:
        sizes = {"f": len(data["names"]), "n": len(data["bin"]), "2": 2}
        for array, shape, *_ in tables_of("The arrays of granules.npz"):
            wanted = tuple(sizes[part] for part in re.findall(r"\w", shape))
            assert data[array.strip("`")].shape == wanted
        assert first_column("The arrays of granules.npz") == data.files


def test_the_page_names_the_arrays_of_joint_npz(small_run: Result) -> None:
    """With their shapes: of a run whose response to the inputs has a lack of fit of its own in every draw."""
    assert small_run.landings is not None
    record, told = small_run.landings.joint, tables_of("The arrays of joint.npz")
    assert record is not None
    sizes = {"N": record.draws, "f": len(record.fractions), "k": len(record.inputs), "b": len(record.bins) + 1}
    with np.load(small_run.folder / "joint.npz") as data:
        sizes["c"] = data["base"].shape[1]
        assert {name.partition(".")[0] for name in data.files} == {one[0].strip("`").partition(".")[0] for one in told}
        for array, shape, *_ in told:
            kind = array.strip("`").partition(".")[0]
            for name in (name for name in data.files if name.partition(".")[0] == kind):
                wanted = re.findall(r"\w", shape)
                found = data[name].shape
                assert len(found) == len(wanted)
                assert all(size == sizes.get(letter, size) for size, letter in zip(found, wanted, strict=True)), name
        assert sum(len(data[name]) - 1 for name in data.files if name.startswith("edges.")) < sizes["c"]


@pytest.mark.parametrize("file", ["tracks.vtp", "landings.vtp"])
def test_the_page_names_the_arrays_of_the_vtk_files(small_run: Result, file: str) -> None:
    import pyvista

    data = pyvista.read(small_run.folder / file)
    told = {"point": data.point_data.keys(), "cell": data.cell_data.keys(), "file": data.field_data.keys()}
    named = [row for row in tables_of("The arrays of the VTK files") if row[0] == f"`{file}`"]
    for where, arrays in told.items():
        listed = {name for row in named if row[2] == where for name in _names(row[1])}
        assert sorted(listed - {"loop time (s)"}) == sorted(arrays)


def test_the_page_names_every_file(small_run: Result) -> None:
    named = " ".join(first_column("Results")).replace("`", "")
    for path in small_run.folder.iterdir():
        if not path.name.startswith("."):
            assert path.name in named, path.name


KEY = re.compile(r"\b[a-z]+\.[a-zA-Z_.]+|--force [a-z.-]+=o|\[[a-z.A-Z]+\]")  # air.speed, --force lift=on, [vibration]


def test_granules_that_leave_above_are_told_and_those_that_fall_are_not() -> None:
    scene = shipped("aspirator")
    above, below = scene.level + 0.1, scene.level - 0.1
    position = np.array([[0.0, above], [0.0, above], [0.0, below], [0.0, above]])
    landing = landings_in([-1, -1, -1, 0], position=position, fate=np.full(4, Fate.ESCAPED))  # the last one in a bin
    tracked = cast("Any", SimpleNamespace(landings={"straw": landing}))
    (told,) = _out_of_the_top(scene, tracked)
    assert told.text.startswith("straw: 0.5 of it leaves through the top")
    assert "on = 'top'" in told.text
    (thrown,) = _out_of_the_top(scene.replace({"air.direction": "down"}), tracked)
    assert thrown.text.startswith("straw: 0.5 of it is thrown out through the top")
    assert "channel.top" in thrown.text


def test_the_gravest_stand_on_screen_and_the_rest_are_counted(capsys: pytest.CaptureFixture[str]) -> None:
    plan = make_plan(shipped("rhombus"), force={"collisions": False, "air-loading": False})
    warn(plan.warnings, [notice.grade.value for notice in plan.notices])
    out = capsys.readouterr().out
    assert plan.notices[0].grade is Grade.VOID  # 500 kg/h are far beyond independent granules
    assert sum(out.count(f"! {grade.value}: ") for grade in Grade) == MAX_WARNINGS
    assert f"! and {len(plan.notices) - MAX_WARNINGS} more" in out


def test_what_upward_air_carries_out_has_its_own_bin() -> None:
    scene = shipped("aspirator")
    assert scene.with_top() is scene  # it has a bin up there
    tables = scene.tables()
    del tables["bin"]["light"], tables["fraction"]["straw"]["target"], tables["fraction"]["internodes"]["target"]
    lost = Scene.parse(tables)
    caught = lost.with_top()
    assert [list(lost.bin), list(caught.bin)] == [["heavy"], ["heavy", "top"]]
    assert np.array_equal(caught.bin["top"].line(caught)[:, 0], [-0.1, 0.1])
    assert lost.replace({"air.direction": "down"}).with_top().bin == lost.bin
    assert make_plan(lost).airflow.kind == "analytic"

    landing = landings_in([1, 1, 0, 1], position=np.full((4, 2), 0.6), fate=np.full(4, Fate.BINNED))
    (told,) = _out_of_the_top(caught, cast("Any", SimpleNamespace(landings={"straw": landing})))
    assert (told.grade, told.text) == (
        Grade.INFORMATION,
        "straw: 0.75 of it leaves through the top with the air, counted as top; a lower air.speed keeps it in",
    )


def test_every_ending_that_is_no_landing_names_a_key_to_change() -> None:
    fates = {"straw": {"binned": 80, **dict.fromkeys(ENDINGS, 4)}}
    told = list(_unlanded(fates))
    assert len(told) == len(ENDINGS)
    assert not [notice.text for notice in told if not KEY.search(notice.text.partition(";")[2])]


def test_every_doubt_of_a_shipped_plan_ends_with_the_key_to_change() -> None:
    for name in ("rhombus", "prism", "aspirator"):
        doubts = [one.text for one in make_plan(shipped(name)).notices if one.grade is not Grade.INFORMATION]
        assert not [text for text in doubts if not KEY.search(text[-110:])], name
