"""Runs next to each other: what differs, by how much, how surely; which input moves which number."""

import csv
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wakeflow as wf
from support import Here, shipped
from wakeflow.answer.result import VOID, Result
from wakeflow.answer.result_table import DONE, FAILED, Difference, Entry, ResultTable, TableQuantity, differences_of
from wakeflow.answer.shares import least_certain
from wakeflow.cli import main
from wakeflow.core.errors import SceneError, known
from wakeflow.extras.studies.sensitivity import COLUMNS
from wakeflow.extras.trays.calibration_update import half_of
from wakeflow.flight.stages.pipeline import Pipeline
from wakeflow.planning.unknowns import unknowns
from wakeflow.runs.planned import make_plan
from wakeflow.show import many_figures as many
from wakeflow.show.many_figures import draw_lines
from wakeflow.show.terminal import show_table
from wakeflow.show.words import bins_in_words, holds, percent


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[wf.Result]:
    folder = tmp_path_factory.mktemp("runs")
    few = {"feed.rate": "0.5 kg/hour", "feed.count": 1024, "fraction.wheat.restitution": 0.3}  # nobody meets
    scene = shipped("rhombus", {"numerics.rung": "none", **few, "fraction.*.impact": "paper"}).without_air()
    bouncy = scene.replace({"fraction.wheat.restitution": 0.6, "bin.middle.from": "-13 mm"})
    asked = {"as-it-is": scene, "bouncy": bouncy}
    return [wf.run(one, folder / name, report=False) for name, one in asked.items()]


def test_inputs_are_what_differs(runs: list[wf.Result]) -> None:
    found = wf.compare(runs)
    first, second = found.table.entries
    assert (first.name, second.name) == ("as-it-is", "bouncy")
    assert second.inputs["fraction.wheat.restitution"] == 0.6
    assert second.inputs["bin.middle.from"] == pytest.approx(-0.013)
    assert set(first.inputs) == {"fraction.wheat.restitution", "bin.middle.from"}
    assert found.table.inputs["bin.middle.from"] == "m"


def test_differences_have_intervals_that_hold_both(runs: list[wf.Result]) -> None:
    found = {one.quantity: one for one in wf.compare(runs).differences}
    a, b = (run.landings.separation.recovery["wheat"] for run in runs)
    wheat = found["recovery.wheat"]
    assert wheat.value == pytest.approx(b.value - a.value)
    assert wheat.low < wheat.value < wheat.high
    assert wheat.clear
    assert 2.0 * max(a.numerical, b.numerical) < wheat.half < a.half + b.half  # the draws of friction act more on one
    assert not found["share.dust.inner-left"].clear  # the same dust in both
    assert not found["share.wheat.middle"].clear
    thrown = wf.compare(runs).table.entries[0].by_name["throughput.outer-left"]
    assert thrown.value == pytest.approx(runs[0].landings.separation.throughput["outer-left"])
    wheat, feed = runs[0].scene["fraction"]["wheat"]["mass_share"], 3600.0 * runs[0].joint.flow
    ends = [feed * wheat * one for one in runs[0].share("wheat", "outer-left").ends]
    assert ends[0] <= thrown.low < thrown.value  # little else flies so far
    assert ends[1] <= thrown.high < 1.2 * ends[1]
    wider = found["throughput.inner-left"]
    assert wider.known
    assert wider.clear
    assert wider.high < 0.0


def test_numbers_without_draws_differ_by_both_of_their_intervals() -> None:
    share = TableQuantity(0.1, 0.05, 0.2, 0.01, name="recovery.dust", unit="1", error=0.1)
    solved = replace(share, value=0.94, low=0.91, high=1.0, numerical=0.02)

    def against(one: TableQuantity, other: TableQuantity, reason: str = "") -> Difference:
        entries = Entry("air", {}, DONE, "", (one,)), Entry("x", {}, DONE, reason, (other,))
        (found,) = differences_of(entries)
        return found

    clear = against(solved, share)
    assert clear.clear
    assert clear.value == pytest.approx(-0.84)
    assert clear.low == pytest.approx(-0.84 - math.hypot(0.05, 0.06))
    assert clear.high == pytest.approx(-0.84 + math.hypot(0.1, 0.03))
    wide = against(solved, replace(share, value=0.0, low=0.0, high=1.0))
    assert not wide.clear
    assert (wide.low, wide.high) == (-1.0, pytest.approx(-0.94 + math.hypot(1.0, 0.03)))  # parts of a whole
    assert not against(solved, share, VOID).clear
    assert not against(solved, replace(share, low=math.nan, high=math.nan)).known


def test_the_difference_of_two_designs_holds_what_drawn_inputs_make_of_it(tmp_path: Path) -> None:
    """Two vacuum machines whose bins part at 100 and at 150 mm: whatever the inputs are, they are the same in both. The
    machine flies under drawn inputs, each time over both bins. What computing alone leaves open holds far fewer.
    """
    places = 0.1, 0.15
    designs = [shipped("vacuum", {"feed.count": 512, "bin.near.to": at, "bin.far.from": at}) for at in places]
    runs = [wf.run(one, tmp_path / f"{i}", report=False) for i, one in enumerate(designs)]
    [told] = [one for one in wf.compare(runs).differences if one.quantity == "recovery.hard"]
    assert told.clear
    first, second = (run.recovery("hard") for run in runs)
    assert told.value == pytest.approx(second.value - first.value)
    assert told.half < 0.8 * math.hypot(first.half, second.half)  # of two machines whose inputs have nothing in common
    alone = math.hypot(first.numerical, second.numerical)
    assert told.half > 1.5 * alone
    drawn = unknowns(designs[0], make_plan(designs[0]))
    chance, found = np.random.default_rng(1), []
    for _ in range(60):
        z = chance.standard_normal(len(drawn))
        changes = {one.key: max(0.0, one.at(at)) for one, at in zip(drawn, z, strict=True)}
        scene = designs[0].replace({**changes, "feed.count": 1024, "feed.seed": 7})
        landed = Pipeline(scene, make_plan(scene)).tracks().landings["hard"].position[:, 0]
        shares = [np.mean((landed >= at) & (landed < 0.3)) for at in places]
        found.append(shares[1] - shares[0])
    inside = [told.low <= one <= told.high for one in found]
    assert sum(inside) >= 54  # of 57 that are expected of 60
    assert sum(abs(one - told.value) <= alone for one in found) < 48


def test_an_answer_without_its_air_is_void_in_every_table(
    runs: list[wf.Result], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where the air could move a fraction by body widths; the number stays in result.json."""
    assert not runs[0].void
    aired = shipped("rhombus", {"numerics.rung": "none", "feed.rate": "0.5 kg/hour", "feed.count": 64})
    blown = wf.run(aired, tmp_path / "blown", report=False)
    assert (blown.void, blown.caveat) == (True, "void")
    assert "leaves the air out, which could move it by" in blown.why_void
    assert repr(blown).endswith("blown: void>")
    assert "VOID: the answer is worth nothing" in holds(blown)
    assert {word for row in bins_in_words(blown, blown.landings.separation) for word, _ in row.shares} == {"void"}
    show_table(wf.compare([runs[0], blown]).table)
    said = capsys.readouterr().out
    assert "void" in said
    assert "! blown: the answer is void" in said


def test_the_command_prints_and_writes(
    runs: list[wf.Result], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", *(str(run.folder) for run in runs), "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "bouncy" in out
    assert "recovery.wheat" in out
    assert (tmp_path / "compare.csv").read_text().startswith("scene,state,")
    lines = (tmp_path / "differences.csv").read_text().splitlines()
    assert any(line.startswith("bouncy,as-it-is,recovery.wheat,") and ",yes,1" in line for line in lines)
    assert (tmp_path / "figures" / "trade-off.png").exists()
    page = (tmp_path / "compare.html").read_text()
    assert "<td>bin.middle.from</td>" in page
    assert "<td>-13 mm</td>" in page
    wheat = (run.landings.separation.recovery["wheat"] for run in runs)
    assert all(f"<td>{percent(one)} %</td>" in page for one in wheat)
    assert '<td class="clear">' in page
    assert "src=" not in page  # neither run has a report, and so no pictures
    assert "http" not in page


def test_what_cannot_be_compared(runs: list[wf.Result], tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="give a list of runs"):
        wf.compare("runs/vacuum")
    with pytest.raises(SceneError, match="at least two"):
        wf.compare(runs[:1])
    with pytest.raises(SceneError, match="given twice"):
        wf.compare([runs[0], runs[0]])
    with pytest.raises(SceneError, match="holds no finished run"):
        wf.compare([runs[0], tmp_path])


def test_what_stands_against_a_table_is_told_below_it(capsys: pytest.CaptureFixture[str]) -> None:
    same = (TableQuantity(0.9, 0.8, 1.0, name="recovery.wheat", unit="1", error=0.1),)
    entries = [
        Entry(f"{speed}-{mass}", {"air.speed": speed, "feed.rate": mass}, DONE, "void" if mass > 1.0 else "", same)
        for speed in (3.0, 4.0)
        for mass in (1.0, 2.0)
    ]
    entries[1] = replace(entries[1], quantities=(replace(same[0], value=0.7),))
    table = ResultTable(entries)
    assert table.caveats == {"void": ["3.0-2.0", "4.0-2.0"]}
    assert table.idle() == []  # at 2 kg/s the air's speed changes something
    calm = ResultTable([entries[0], entries[2]])
    assert calm.idle() == ["air.speed"]
    show_table(table)
    show_table(calm)
    out = capsys.readouterr().out
    assert "! 3.0-2.0, 4.0-2.0: the answer is void" in out
    assert "! air.speed changes no number here" in out


@pytest.mark.parametrize("width", [30, 60, 200])
def test_a_wide_table_is_parted_where_it_fits_no_more(
    width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    shares = tuple(
        TableQuantity(0.1 * i, 0.1 * i - 0.05, 0.1 * i + 0.07, name=f"share.wheat.bin-{i}", unit="1") for i in range(8)
    )
    faster = tuple(replace(one, value=0.9 * one.value) for one in shares)
    entries = [Entry(f"{v}", {"air.speed": v}, DONE, "", found) for v, found in ((3.0, shares), (4.5, faster))]
    show_table(ResultTable([*entries, Entry("5", {"air.speed": 5.0}, FAILED, "its reason")]))
    lines = capsys.readouterr().out.splitlines()
    assert all(len(line) <= width for line in lines)
    assert [sum(f"bin-{i}" in line for line in lines) for i in range(8)] == [1] * 8  # whole and once
    parts = sum("4.5" in line for line in lines)  # the inputs stand in each
    assert parts == 1 if width == 200 else parts > 1
    assert sum(FAILED in line for line in lines) == parts


@pytest.mark.parametrize("count", [2, 9])
def test_a_legend_leaves_its_panel_room_whatever_the_names(count: int, tmp_path: Path) -> None:
    fractions = [f"straw-that-the-combine-broke-{i}" for i in range(6)]
    entries = [
        Entry(
            f"{speed}-{i}",
            {"air.speed": speed, **{f"body.row{j}.at-the-left-of-the-channel": 7.0 * i for j in range(8)}},
            DONE,
            "",
            tuple(TableQuantity(0.1, 0.05, 0.2, name=f"share.{one}.outer-left", unit="1") for one in fractions),
        )
        for speed in (3.0, 4.0)
        for i in range(count)
    ]
    draw_lines(tmp_path / "lines.png", ResultTable(entries), [q.name for q in entries[0].quantities], "air.speed")
    texts = (tmp_path / "lines.svg").read_text()
    assert all(texts.count(f">share.{one}.outer-left<") == 1 for one in fractions)
    assert (texts.count("at-the-left-of-the-channel 7, ") > 0) == (count == 2)  # more are points with bars


def _grid_of(low: float, high: float) -> ResultTable:
    """Scenes over two inputs, 0 and 0.001 of the dust recovered, each with the interval low to high."""
    entries = [
        Entry(
            f"{speed}-{gamma}", {"air.speed": speed, "vibration.gamma": gamma}, DONE, "",
            tuple(TableQuantity(0.001 * (speed > 3.0), low, high, name=f"{kind}.dust", unit="1") for kind in KINDS),
        )
        for speed in (3.0, 4.0)
        for gamma in (1.0, 2.0)
    ]  # fmt: skip
    return ResultTable(entries, {"dust": ("near",)})


KINDS = ("recovery", "purity.near")


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Figures as they are about to be saved."""
    kept: list[Any] = []
    monkeypatch.setattr(many, "save", lambda figure, path: kept.append(figure))
    return kept


def test_whiskers_of_one_value_stand_beside_each_other(drawn: list[Any]) -> None:
    many.draw_lines(Path("unused"), _grid_of(0.0, 1.0), ["recovery.dust"], "air.speed")
    [axes] = drawn[0].axes
    ends = np.array([part for bars in axes.collections for part in bars.get_segments()])  # whisker, end, x and y
    assert len(ends) == 4
    x = np.sort(ends[:, 0, 0])
    assert np.diff(x).min() > 0.1  # of the 1 m/s between two speeds: none hides another
    assert np.abs(x - [3.0, 3.0, 4.0, 4.0]).max() < 0.1  # each still next to its own
    assert (ends[:, :, 1] == [0.0, 100.0]).all()


@pytest.mark.parametrize(("low", "high", "ends"), [(0.0, 1.0, (0.0, 50.05)), (0.0, 0.0005, (0.0, 0.1))])
def test_a_map_shows_no_difference_that_the_intervals_hide(
    low: float, high: float, ends: tuple[float, float], drawn: list[Any]
) -> None:
    many.draw_map(Path("unused"), _grid_of(low, high), ["recovery.dust"], "air.speed", "vibration.gamma")
    axes = drawn[0].axes[0]
    assert axes.collections[0].get_clim() == pytest.approx(ends)
    told = [text.get_text() for text in axes.texts]
    assert (told.count("0.1"), told.count("unknown")) == ((0, 4) if high == 1.0 else (2, 0))
    assert told.count("0 to 100") == (4 if high == 1.0 else 0)


def test_a_map_is_grey_where_nothing_is_known_and_leaves_out_what_nowhere_is(drawn: list[Any]) -> None:
    table = _grid_of(0.0, 1.0)
    empty = TableQuantity(float("nan"), name="purity.far.dust", unit="1")
    table = replace(table, entries=[replace(one, quantities=(*one.quantities, empty)) for one in table.entries])
    many.draw_map(Path("unused"), table, ["recovery.dust", "purity.near.dust", "purity.far.dust"], *table.inputs)
    panels = [axes for axes in drawn[0].axes if axes.get_visible() and axes.texts]
    assert len(panels) == 2
    for axes in panels:
        assert axes.collections[0].get_array().mask.all()  # type: ignore[union-attr]
        assert "unknown" in [text.get_text() for text in axes.texts]
    with pytest.raises(SceneError, match="nothing landed"):
        many.draw_map(Path("unused"), table, ["purity.far.dust"], *table.inputs)


def test_people_read_inputs_in_their_units_and_files_keep_the_si(drawn: list[Any]) -> None:
    entries = [
        Entry(f"{rate}", {"feed.rate": rate / 3600.0, "channel.width": [0.1, 0.2][: rate // 100] or 0.1}, DONE, "",
              (TableQuantity(0.5, 0.4, 0.6, name="recovery.dust", unit="1"),))
        for rate in (0, 100, 200)
    ]  # fmt: skip
    table = ResultTable(entries)
    read = table.read_in({"kg/s": "kg/h", "m": "mm"})
    assert [one.inputs["feed.rate"] for one in read.entries] == [0.0, 100.0, 200.0]
    assert read.headings == ["feed.rate (kg/h)", "channel.width (m)"]  # not a number in each scene
    assert [one.inputs["channel.width"] for one in read.entries] == [one.inputs["channel.width"] for one in entries]
    assert table.tidy().heads[2] == "feed.rate (kg/s)"
    many.draw_lines(Path("unused"), table, ["recovery.dust"], "feed.rate")
    assert drawn[0].axes[0].get_xlabel() == "feed.rate (kg/h)"


def test_a_few_scenes_are_named_at_their_points(drawn: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    many.draw_trade_off(Path("unused"), _grid_of(0.0, 0.0))
    [axes] = drawn[0].axes
    told = [text.get_text() for text in axes.get_legend().get_texts()]
    assert told == ["dust in near", *(f"speed {speed}, gamma {gamma}" for speed in (3, 4) for gamma in (1, 2))]
    assert {text.get_text(): text.xy for text in axes.texts} == {"1,2": (0.0, 0.0), "3,4": (0.1, 0.1)}
    monkeypatch.setattr(many, "MAX_NUMBERED_SCENES", 3)
    many.draw_trade_off(Path("unused"), _grid_of(0.0, 0.0))
    [axes] = drawn[1].axes
    assert not axes.texts
    assert len(axes.get_legend().get_texts()) == 1


SETTINGS = {"feed.count": 512, "uncertainty.fraction.hard.restitution": 0.05, "uncertainty.feed.height": 0.0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("sensitivity") / "run"
    wf.run(shipped("vacuum", SETTINGS), out, rung="none", report=False)
    assert main(["sensitivity", str(out), "--quiet"]) == 0
    return out


def test_the_table_holds_what_the_result_holds(folder: Path) -> None:
    result = Result.load(folder)
    assert result.landings.inputs["fraction.hard.restitution"].high == pytest.approx(0.55)
    with (folder / "sensitivity.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == tuple(COLUMNS)
    own = [row for row in rows if row["quantity"] == "share.hard.near"]
    assert {row["input"] for row in own} == {
        "fraction.hard.restitution", "fraction.hard.friction", "fraction.hard.size", "feed.width", "feed.position",
    }  # fmt: skip
    parts = result.landings.measure_next["hard"]["near"]  # type: ignore[index]
    for row in own:
        assert float(row["change at high"]) == pytest.approx(parts[row["input"]].rise)
        assert abs(float(row["change at low"])) == pytest.approx(parts[row["input"]].half)
    total = sum(float(row["index"]) for row in own)
    assert 0.8 < total <= 1.005  # nearly linear: little is left for interactions


def test_half_the_uncertainty_moves_a_share_half_as_far(folder: Path, tmp_path: Path) -> None:
    settings = {"feed.count": 512, "uncertainty.fraction.hard.restitution": 0.1}
    wide = wf.run(shipped("vacuum", settings), tmp_path, rung="none", report=False)
    narrow = Result.load(folder)
    assert wide.landings is not None
    assert narrow.landings is not None
    key = "fraction.hard.restitution"
    parts = [one.landings.measure_next["hard"]["near"][key] for one in (narrow, wide)]  # type: ignore[index, union-attr]
    assert parts[0].half == pytest.approx(0.5 * parts[1].half, rel=0.25)
    a, b = (one.landings.separation.fractions["hard"]["near"] for one in (narrow, wide))  # type: ignore[union-attr]
    assert a.value == b.value
    assert a.numerical == pytest.approx(b.numerical, rel=1e-12)
    assert a.high - a.low < b.high - b.low
    [left] = wf.sensitivity(wide).remaining({key: 0.05})["hard"]
    assert (left.now, left.measured, left.alone) == (pytest.approx(0.1), 0.05, left.together)
    there, here = (known(one.landings.separation.recovery["hard"]).half for one in (narrow, wide))  # type: ignore[union-attr]
    assert abs(left.alone - there) < 0.5 * (here - there)  # as the narrower run says, to the noise of 64 draws


def test_what_inputs_leave_of_a_recovery_once_they_are_known(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = wf.sensitivity(folder)
    every = found.remaining()["hard"]
    half = known(known(found.result.landings).separation.recovery["hard"]).half
    assert [one.measured for one in every] == [0.0] * len(every)
    parts = known(known(found.result.landings).of_targets)["recovery.hard"]
    moves = [parts[one.key].half for one in every]
    assert moves == sorted(moves, reverse=True)
    assert every[0].alone < 0.75 * half
    left = [half, *(one.together for one in every)]
    assert left == sorted(left, reverse=True)  # who measures more knows more
    assert all(one.alone <= half for one in every)
    own = found.result.joint.own  # what is left once all are known: everything but the inputs
    others = own.values(known(own.of_name("recovery.hard")), frozenset(one.name for one in own.joint.sources))
    assert left[-1] == pytest.approx(half_of(others.mean(axis=0)), rel=0.25)
    same = found.remaining({"fraction.hard.restitution": 9.0, "feed.width": "0 mm"})["hard"]
    assert {one.key: one.alone for one in same}["fraction.hard.restitution"] == half
    assert {one.key: one.alone for one in every}["feed.width"] == {one.key: one.alone for one in same}["feed.width"]
    for wrong in ({"feed.wdth": "1 mm"}, {"feed.width": "1 s"}, {"feed.width": -1.0}, {"feed.width": math.nan}):
        with pytest.raises(SceneError, match=r"--known feed\.w"):
            found.remaining(wrong)
    assert main(["sensitivity", str(folder), "--known", "feed.width=1 mm"]) == 0
    assert "recovery.hard" in capsys.readouterr().out


def test_the_figure_and_the_terminal_name_the_number(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("sensitivity.png", "sensitivity.svg"):
        assert (folder / "figures" / name).stat().st_size > 2000
    assert main(["sensitivity", str(folder)]) == 0
    told = capsys.readouterr().out
    assert "fraction.hard.restitution" in told
    result = Result.load(folder)
    assert result.landings is not None
    place, parts = least_certain(result.landings)["hard"]
    assert place in ("near", "far")
    assert next(iter(parts)) == max(parts, key=lambda key: parts[key].half)
    assert main(["sensitivity", str(folder), "--set", "feed.count=64"]) == 2
    assert "give its scene file" in capsys.readouterr().err


def test_a_sweep_of_both_ends_agrees_with_the_draws(folder: Path) -> None:
    """Restitution moves the hard granule's share nearly linearly: flown anew at the ends of its interval the share
    changes as the draws say, within the errors of both, to either side. Nobody doubts the height of the feed: the draws
    say nothing of it, the sweep does. What is flown stands where it is looked for, and is not flown twice.
    """
    key, quantity = "fraction.hard.restitution", "share.hard.near"
    drawn = wf.sensitivity(folder)
    found = wf.sensitivity(folder, over=[key, "feed.height=80 mm,120 mm"], scheduler=Here())
    before = next(one for one in drawn.by_quantity[quantity] if one.key == key)
    after = {one.key: one for one in found.by_quantity[quantity]}
    assert (before.how, after[key].how) == ("draws", "sweep")
    assert (after[key].low, after[key].high) == (before.low, before.high)
    assert after[key].index == before.index
    assert before.error is not None
    assert -before.at_low == before.at_high  # the draws tell the mean of both ways
    straight = 0.5 * (after[key].at_high - after[key].at_low)  # type: ignore[operator]
    assert after[key].error is not None  # of flights of few granules, as the draws have theirs
    assert straight == pytest.approx(before.at_high, abs=float(np.hypot(before.error, after[key].error)))
    assert before.at_high < 0.0 < before.at_low  # type: ignore[operator]
    assert "feed.height" not in {one.key for one in drawn.moves}
    higher = after["feed.height"]
    assert (higher.low, higher.high, higher.unit) == (0.08, 0.12, "m")
    assert higher.at_high < 0.0 < higher.at_low  # type: ignore[operator]  # it throws them farther
    assert {one.quantity for one in found.moves} >= {quantity, "recovery.hard", "purity.near.hard"}
    assert len(found.frame()["quantity"]) == len(found.moves)
    assert found.plot(["recovery.hard"], folder / "hard.png").stat().st_size > 2000
    again = Here()
    assert wf.sensitivity(folder, over=[key, "feed.height=80 mm,120 mm"], scheduler=again).moves == found.moves
    assert not again.calls


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ("fraction.hard.restitutio", "did you mean 'fraction.hard.restitution'"),
        ("feed.height", "give its ends"),
        ("feed.height=80 mm", "give its two ends"),
        ("fraction.hard.target=near,far", "a sensitivity is that of a number"),
    ],
)
def test_a_wrong_key_is_one_line(over: str, said: str, folder: Path) -> None:
    with pytest.raises(wf.SceneError, match=said):
        wf.sensitivity(folder, over=[over], scheduler=Here())


@pytest.mark.parametrize(
    ("over", "said"),
    [("feed.heigth=80 mm,120 mm", "unknown key 'heigth'; did you mean 'height'"), ("feed.height=1:2:x", "--over")],
)
def test_a_wrong_key_of_a_scene_is_told_before_it_is_run(over: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(wf.SceneError, match=said):
        wf.sensitivity(shipped("vacuum", SETTINGS), tmp_path, over=[over], rung="none")
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    "over",
    [
        ["feed.height=80 mm,120 mm", "feed.height=60 mm,70 mm"],
        ["feed.height", "feed.height=80 mm,120 mm"],
        {"feed.height": [0.08, 0.12], "feed.width = feed.height": [0.01, 0.02]},
    ],
)
def test_a_key_that_is_given_twice_is_refused_before_anything_is_run(over: Any, tmp_path: Path) -> None:
    with pytest.raises(wf.SceneError, match=r"feed.height is given twice"):
        wf.sensitivity(shipped("vacuum", SETTINGS), tmp_path, over=over, rung="none")
    assert not any(tmp_path.iterdir())


def test_a_run_in_which_nothing_is_unknown_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = Path(__file__).parents[3] / "cases" / "vacuum.toml"
    keys = [f"fraction.{name}.{key}" for name in ("soft", "hard") for key in ("restitution", "friction", "size")]
    keys += ["feed.width", "feed.position", "feed.height"]
    exact = [part for key in keys for part in ("--set", f"uncertainty.{key}=0")]
    code = main(["sensitivity", str(scene), "--out", str(tmp_path), "--set", "feed.count=64", *exact, "--quiet"])
    assert code == 2
    assert "[uncertainty]" in capsys.readouterr().err
