"""Dividers that move over stored landings: the run's own answer where they stay, that of another run where they go."""

import time

import pytest

import wakeflow as wf
from wakeflow.core.errors import SceneError
from wakeflow.scene import Scene
from wakeflow.statistics.moved import StoredLandings


@pytest.fixture(scope="module")
def stored(small_run: wf.Result) -> StoredLandings:
    return StoredLandings.of(small_run)


def test_at_its_own_dividers_the_answer_is_the_runs(stored: StoredLandings, small_run: wf.Result) -> None:
    assert small_run.landings is not None
    separation, found = small_run.landings.separation, stored.shares({})
    assert {name: row | {} for name, row in found.fractions.items()} == separation.fractions
    assert found.recovery == separation.recovery
    assert all(found.purity[place] == separation.purity[place] for place in found.purity)


def test_moved_dividers_give_what_a_run_with_them_gives(
    stored: StoredLandings, small_run: wf.Result, tmp_path_factory: pytest.TempPathFactory
) -> None:
    ends = {"near": (0.0, 0.06), "far": (0.06, 0.3)}
    changes = {"bin.near.to": 0.06, "bin.far.from": 0.06}
    other = wf.run(
        Scene.parse(small_run.scene).replace(changes), tmp_path_factory.mktemp("moved") / "moved", report=False
    )
    found = stored.shares(ends)
    assert other.landings is not None
    for name, row in other.landings.separation.fractions.items():
        for place, share in row.items():
            assert found.fractions[name][place].value == pytest.approx(share.value, abs=0.02), (name, place)
            assert found.fractions[name][place].low <= share.value <= found.fractions[name][place].high
        assert sum(one.value for one in found.fractions[name].values()) == pytest.approx(1.0, abs=1e-9)
    for place, pure in other.landings.separation.purity.items():
        for name, one in (pure or {}).items():
            assert found.purity[place][name].value == pytest.approx(one.value, abs=0.03), (name, place)


def test_an_answer_is_there_under_the_mouse(stored: StoredLandings) -> None:
    began = time.thread_time()  # of this thread's own work: the machine may have other
    for i in range(20):
        stored.shares({"near": (0.0, 0.05 + 1e-3 * i), "far": (0.05 + 1e-3 * i, 0.3)})
    assert (time.thread_time() - began) / 20 < 0.05  # s


@pytest.mark.parametrize(
    ("ends", "words"),
    [
        ({"nowhere": (0.0, 0.1)}, "no bin 'nowhere'"),
        ({"near": (0.1, 0.0)}, "must be below"),
        ({"near": (0.0, 0.2)}, "overlap"),
    ],
)
def test_dividers_that_cannot_be_are_refused(
    ends: dict[str, tuple[float, float]], words: str, stored: StoredLandings
) -> None:
    with pytest.raises(SceneError, match=words):
        stored.shares(ends)
