"""Measured shares: what a file of trays may look like, what is refused in one line, how sure a share is."""

from pathlib import Path

import numpy as np
import pytest

from support import shipped
from wakeflow.core.errors import SceneError
from wakeflow.scene import Scene
from wakeflow.scene.measured import Measured, Tray, read_trays
from wakeflow.scene.uncertainty import SIGMAS


def written(folder: Path, text: str) -> Path:
    path = folder / "measured.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_a_file_of_trays_is_read_with_any_separator_and_percent(tmp_path: Path, mark: str) -> None:
    text = "# a note\nfraction,bin,share,uncertainty\nhard,far,62 %,0.02\n,near,0.5,3 %\n".replace(",", mark)
    one, other = read_trays(written(tmp_path, text))
    assert (one.fraction, one.bin, one.share, one.uncertainty) == ("hard", "far", 0.62, 0.02)
    assert (other.fraction, other.bin, other.share, other.uncertainty) == (None, "near", 0.5, pytest.approx(0.03))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty; its first line is fraction,bin,share,uncertainty"),
        ("fraction,bin,share,uncertainty\n", "holds no tray"),
        ("fraction,bin,shares\nhard,far,0.5\n", "head 'shares' is unknown; did you mean 'share'?"),
        ("fraction,bin\nhard,far\n", "lacks bin, or share, mass or count"),
        ("fraction,bin,count\nhard,far,\n", "line 2: is not filled in"),
        ("fraction,bin,count\nhard,far,3.5\n", "line 2: count = '3.5': granules are counted in whole numbers"),
        ("fraction,bin,share,uncertainty\nhard,far,62,1\n", "write a share from 0 to 1, or 62 %"),
        ("fraction,bin,share,uncertainty\nhard,far,0.5\n", "line 2: has 3 cells, its heads are 4"),
        ("fraction,bin,share,uncertainty\nhard,far,0.5,\n", "line 2: hard in far: give its uncertainty"),
        ("fraction;bin;share;uncertainty\nhard;far;0,5;0.1\n", "write a decimal point: 0.5"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line_that_names_its_own(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SceneError, match=r"^measured: ") as caught:
        read_trays(written(tmp_path, text))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"measured: cannot read .*No such file"):
        read_trays(tmp_path / "nowhere.csv")


def test_counts_have_the_chance_of_a_finite_sample() -> None:
    """Over many samples of 200 granules the stated covariance is that of what is found."""
    true, chance = np.array([0.2, 0.5, 0.3]), np.random.default_rng(1)
    drawn = chance.multinomial(200, true, size=4000) / 200
    found = Measured.of([Tray(fraction="a", bin=f"b{i}", count=round(200 * p)) for i, p in enumerate(true)])
    np.testing.assert_allclose(found.shares, true)
    np.testing.assert_allclose(found.covariance, np.cov(drawn.T), atol=1.5e-4)
    none = Measured.of([Tray(fraction="a", bin="b0", count=0), Tray(fraction="a", bin="b1", count=50)])
    assert none.numbers()[0].high > 0.01  # nothing was found of fifty


def test_masses_are_shares_of_their_sum_with_all_their_errors() -> None:
    trays = [Tray(bin="b0", mass=30.0, uncertainty=1.0), Tray(bin="b1", mass=70.0, uncertainty=2.0)]
    found, chance = Measured.of(trays), np.random.default_rng(2)
    drawn = np.array([30.0, 70.0]) + np.array([1.0, 2.0]) / SIGMAS * chance.standard_normal((40000, 2))
    drawn /= drawn.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(found.shares, [0.3, 0.7])
    np.testing.assert_allclose(found.covariance, np.cov(drawn.T), rtol=0.04)


def test_an_unsorted_tray_holds_every_fraction_by_its_mass() -> None:
    found = Measured.of([Tray(bin="near", share=0.5, uncertainty=0.02)])
    known = [("hard", "near"), ("hard", "far"), ("soft", "near"), ("soft", "far")]
    np.testing.assert_allclose(found.weights(known, {"hard": 0.8, "soft": 0.2}), [[0.8, 0.0, 0.2, 0.0]])


def test_a_scene_takes_its_trays_from_a_file_and_keeps_them(tmp_path: Path) -> None:
    file = written(tmp_path, "fraction,bin,share,uncertainty\nhard,far,0.62,0.02\n")
    scene = shipped("vacuum", {"measured": str(file)})
    scene.save(tmp_path / "scene.toml")
    assert Scene.load(tmp_path / "scene.toml") == scene
    assert scene.measured[0].about == "hard in far"


@pytest.mark.parametrize(
    ("trays", "message"),
    [
        ([{"bin": "neer", "share": 0.1, "uncertainty": 0.1}], "no bin 'neer'; did you mean 'near'?"),
        ([{"bin": "near", "fraction": "heard", "share": 0.1, "uncertainty": 0.1}], "no fraction 'heard'"),
        ([{"bin": "near", "share": 0.1}], "give its uncertainty"),
        ([{"bin": "near", "uncertainty": 0.1}], "give share, mass or count, one of them"),
        ([{"bin": "near", "count": 0}], "nothing lay in any tray of it"),
        ([{"bin": "near", "count": 3}, {"bin": "far", "share": 0.1, "uncertainty": 0.1}], "all trays of it as"),
    ],
)
def test_trays_that_do_not_fit_the_scene_are_refused(trays: list[dict[str, object]], message: str) -> None:
    with pytest.raises(SceneError, match=r"scene: ") as caught:
        shipped("vacuum").replace({"measured": trays})
    assert message in str(caught.value)
