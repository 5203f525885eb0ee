"""Bins that move over a finished run: its own answer where they stay, that of another run where they go."""

import time
from dataclasses import replace

import numpy as np
import pytest

import wakeflow as wf
from wakeflow.answer.cells import Ends
from wakeflow.answer.result import MovedBins, Result
from wakeflow.core.errors import SceneError
from wakeflow.core.number import Number
from wakeflow.extras.page.finished import StoredLandings
from wakeflow.scene import Scene

END = 0.12  # m: where near ends and far begins


def numbers(found: Result | MovedBins) -> dict[str, Number]:
    """Every share, recovery and purity by its name."""
    shares = found.landings.separation if isinstance(found, Result) else found.shares
    told = {f"{name}.{place}": one for name, row in shares.fractions.items() for place, one in row.items()}
    told |= {f"recovery.{name}": one for name, one in shares.recovery.items()}
    return told | {
        f"purity.{place}.{name}": one for place, row in shares.purity.items() for name, one in (row or {}).items()
    }


@pytest.mark.parametrize("ends", [{}, {"near": (0.0, END)}, {"near": (0.0, END), "far": (END, 0.3)}])
def test_at_its_own_dividers_the_answer_is_the_runs(ends: Ends, small_run: Result) -> None:
    """To the last digit, also of a run that is read again."""
    assert small_run.landings is not None
    for result in (small_run, Result.load(small_run.folder)):
        assert replace(result.between(ends).shares, cut=small_run.landings.separation.cut) == (
            small_run.landings.separation
        )
    assert small_run.moved({"bin.near.to": "120 mm"}).recovery("soft") == small_run.recovery("soft")


@pytest.fixture(scope="module", params=[0.11, 0.06])
def elsewhere(
    request: pytest.FixtureRequest, small_run: Result, tmp_path_factory: pytest.TempPathFactory
) -> tuple[float, Result]:
    """Where near ends in it, and a run of the same granules so."""
    end = request.param
    scene = Scene.parse(small_run.scene).replace({"bin.near.to": end, "bin.far.from": end})
    return end, wf.run(scene, tmp_path_factory.mktemp("moved") / "moved", report=False)


def test_moved_dividers_give_what_a_run_with_them_gives(elsewhere: tuple[float, Result], small_run: Result) -> None:
    """The values within what computing alone makes of them; the widths by 10 mm to 15 %."""
    end, other = elsewhere
    found = small_run.moved({"bin.near.to": f"{1000 * end:g} mm", "bin.far.from": end})
    told, wanted = numbers(found), numbers(other)
    assert told.keys() == wanted.keys()
    for name, one in wanted.items():
        assert told[name].value == pytest.approx(one.value, abs=one.numerical), name
        assert told[name].low <= one.value <= told[name].high
        if end == 0.11:
            assert told[name].half == pytest.approx(one.half, rel=0.15), name
    for shares in found.shares.fractions.values():
        assert sum(one.value for one in shares.values()) == pytest.approx(1.0, abs=1e-9)
    assert found.share("hard", "far") == told["hard.far"]
    assert found.recovery("hard") == told["recovery.hard"]
    assert found.purity("near", "soft") == told["purity.near.soft"]


def test_a_tenth_of_a_millimetre_changes_no_width(small_run: Result) -> None:
    """None jumps where a divider meets a granule or leaves an edge of a cell."""
    own = numbers(small_run)
    for by in (-1e-4, 1e-4):
        for name, one in numbers(small_run.between({"near": (0.0, END + by), "far": (END + by, 0.3)})).items():
            assert one.half == pytest.approx(own[name].half, rel=0.05), name


def test_a_bin_that_grows_gains_what_its_neighbour_loses(small_run: Result) -> None:
    ends = np.linspace(0.06, 0.18, 13)
    rows = [small_run.between({"near": (0.0, end), "far": (end, 0.3)}) for end in ends]
    shares = np.array([[row.share("hard", place).value for place in ("near", "far", "elsewhere")] for row in rows])
    assert np.all(np.diff(shares[:, 0]) >= 0.0)
    assert shares[-1, 0] > shares[0, 0] + 0.1
    assert np.ptp(shares[:, 2]) < 1e-12
    apart = small_run.between({"near": (0.0, 0.06), "far": (0.18, 0.3)})  # what lies between is elsewhere
    assert apart.share("hard", "elsewhere").value == pytest.approx(shares[-1, 0] - shares[0, 0] + shares[0, 2])


def test_an_answer_is_there_under_the_mouse(small_run: Result) -> None:
    small_run.between({})  # what every answer of this run needs
    began = time.thread_time()  # of this thread's own work: the machine may have other
    for i in range(20):
        small_run.between({"near": (0.0, 0.05 + 1e-3 * i), "far": (0.05 + 1e-3 * i, 0.3)})
    assert (time.thread_time() - began) / 20 < 0.05  # s


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ({"nowhere": (0.0, 0.1)}, r"no bin 'nowhere' .*known: near, far"),
        ({"naer": (0.0, 0.1)}, "'near'"),
        ({"near": (0.1, 0.0)}, "from = 100 mm must be below to = 0 mm"),
        ({"near": (0.1, 0.1)}, "must be below"),
        ({"near": (0.0, float("nan"))}, "must be below"),
        ({"near": (0.0, 0.2)}, "overlap: far begins at 120 mm"),
        ({"far": (0.12, 0.31)}, "not within the floor, -300 to 300 mm"),
        ({"near": (-0.31, 0.1)}, "not within the floor"),
    ],
)
def test_dividers_that_cannot_be_are_refused(
    ends: dict[str, tuple[float, float]], words: str, small_run: Result
) -> None:
    with pytest.raises(SceneError, match=words):
        small_run.between(ends)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"bin.naer.to": 0.1}, r"'bin.naer.to' is no end of a bin on a side of this run.*bin\.near\.to"),
        ({"bin.near.side": "floor"}, "is no end of a bin"),
        ({"near.to": 0.1}, "is no end of a bin"),
        ({"feed.position": 0.1}, "is no end of a bin"),
        ({"bin.near.to": "90 kg"}, r"bin\.near\.to = '90 kg'"),
        ({"bin.near.to": "wide"}, r"bin\.near\.to = 'wide'"),
        ({"bin.near.to": True}, "needs a number in m or a string such as '90 mm'"),
        ({"bin.near.to": None}, "needs a number in m"),
        ({"bin.near.to": float("inf")}, "needs a number in m"),
        ({"bin.near.to": "200 mm"}, "overlap"),
        ({"bin.near.from": "130 mm"}, "must be below"),
    ],
)
def test_keys_and_lengths_that_cannot_be_are_refused(changes: dict[str, object], words: str, small_run: Result) -> None:
    with pytest.raises(SceneError, match=words):
        small_run.moved(changes)


def test_a_run_without_shares_has_none_to_move(small_run: Result) -> None:
    early = replace(small_run, landings=None)
    with pytest.raises(SceneError, match="ended before them"):
        early.moved({"bin.near.to": 0.1})


def test_a_profile_holds_all_that_landed_on_a_side(small_run: Result) -> None:
    """As pictures draw it: by side and fraction, beside the bins what lies between them."""
    found = StoredLandings.of(small_run)
    profile = found.profile(60)
    assert list(profile) == ["floor"]
    for name, row in profile["floor"].items():
        near = sum(row[30:42])  # 0 to 120 mm of -300 to 300 mm
        assert near == pytest.approx(small_run.share(name, "near").value, abs=0.02)
        assert sum(row) == pytest.approx(1.0, abs=1e-9)
    assert found.ends == {"near": (0.0, END), "far": (END, 0.3)}
