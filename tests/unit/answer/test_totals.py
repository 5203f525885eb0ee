"""The intervals that leave the program: whole for empty bins, alike on both sides of a symmetric machine."""

from __future__ import annotations

from pathlib import Path

import pytest

import wakeflow as wf
from support import shipped

LEFT_OUT = {"numerics.rung": "none", "feed.count": 64, "vibration": {"gamma": 1.0}}


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> wf.Result:
    """The rhombus without its air, fed from its middle."""
    return wf.run(shipped("rhombus", LEFT_OUT), tmp_path_factory.mktemp("still") / "run", report=False)


def test_a_bin_that_got_nothing_holds_what_the_left_out_air_could_bring(still: wf.Result) -> None:
    """Dust thrown outward lands in no middle; carried by the air that is left out nearly all of it does."""
    value, low, high = still.share("dust", "middle")
    assert (value, low) == (0.0, 0.0)
    assert high > 0.9
    assert "share.dust.middle" in {row.quantity for row in still.budget}


def test_every_bin_of_every_fraction_has_a_row(still: wf.Result) -> None:
    rows = {row.quantity for row in still.budget}
    shares = still.landings.separation.fractions
    assert {f"share.{name}.{place}" for name, places in shares.items() for place in places} <= rows


def test_both_sides_of_a_symmetric_machine_have_one_interval(still: wf.Result) -> None:
    for places in still.landings.separation.fractions.values():
        assert places["outer-left"] == places["outer-right"]
        assert places["inner-left"] == places["inner-right"]


def test_no_search_recommends_a_void_answer(tmp_path: Path) -> None:
    """All designs of the finest level are void: none is handed out, and the reason is told."""
    (tmp_path / "rhombus.toml").write_text((Path(__file__).parents[3] / "cases" / "rhombus.toml").read_text())
    file = tmp_path / "search.toml"
    file.write_text(
        '[search]\nscene = "rhombus.toml"\nmaximise = "recovery.wheat"\nbudget = "5 s"\nat_a_time = 2\n'
        '[search.within]\nfeed.height = { from = "60 mm", to = "120 mm" }\n'
        '[search.set]\nnumerics.rung = "none"\nfeed.count = 16\n'
    )
    with pytest.raises(wf.SceneError, match=r"every answer of the finest level would be void"):
        wf.search(file, tmp_path / "out", workers=1)


def test_a_sweep_over_what_nothing_feels_is_refused_before_it_starts(tmp_path: Path) -> None:
    scenes = wf.variants(shipped("rhombus", LEFT_OUT), {"air.speed": ["3 m/s", "4 m/s"]})
    with pytest.raises(wf.SceneError, match=r"air.speed changes nothing at rung none"):
        wf.sweep(scenes, tmp_path / "sweep", workers=1)
    assert not list((tmp_path / "sweep").glob("*/result.json"))
