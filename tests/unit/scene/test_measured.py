"""Measured shares: what a file of trays may look like, what is refused in one line, how sure a share is."""

from pathlib import Path

import numpy as np
import pytest

from support import shipped
from wakeflow.core.errors import SceneError
from wakeflow.scene import Scene
from wakeflow.scene.measured import Measured, Tray, read_trays, trays_of_columns
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
        ("fraction;bin;count\nhard;far;1,000\n", "line 2: count = '1,000' may have thousands parted; write 1000"),
        (
            "fraction,bin,count\nhard,far,1.234.567\n",
            "line 2: count = '1.234.567' may have thousands parted; write 1234567",
        ),
        ("fraction,bin,count\nhard,far,3.5\n", "line 2: count = '3.5': granules are counted in whole numbers"),
        ("fraction,bin,share,uncertainty\nhard,far,62,1\n", "write a share from 0 to 1, or 62 %"),
        ("fraction,bin,share,uncertainty\nhard,far,0.5\n", "line 2: has 3 cells, its heads are 4"),
        ("fraction,bin,share,uncertainty\nhard,far,0.5,\n", "line 2: hard in far: give its uncertainty"),
        ("fraction,bin,share,uncertainty\nhard,far,120 %,1 %\n", "line 2: share = '120 %': must be less than or equal"),
        ("fraction,bin,share,uncertainty\nhard,far,36 %,2\n", "line 2: hard in far: uncertainty = 2: write 1e-06 to 1"),
        ("fraction,bin,share,uncertainty\nhard,far,36 %,2\n", "or '2 %'"),
        ("fraction,bin,share,uncertainty\nhard,far,0.5,1e-9\n", "uncertainty = 1e-09: write 1e-06 to 1"),
        ("fraction,bin,share,uncertainty\nhard,far,0.5,1e300\n", "uncertainty = 1e+300: write 1e-06 to 1"),
        ("fraction,bin,mass,uncertainty\nhard,far,1e-320,1\n", "give 0 or 1e-12 at least, in another unit"),
        ("fraction,bin,mass,uncertainty\nhard,far,1e308,1\n", "line 2: mass = 1e+308: must be less than or equal to"),
        ("fraction,bin,mass,uncertainty\nhard,far,5,1e300\n", "uncertainty = 1e+300: write 1e-12 to 1e+12"),
        ("fraction,bin,mass,uncertainty\nhard,far,0,10 %\n", "line 2: hard in far: give its uncertainty"),
        ("fraction,bin,count\nhard,far,inf\n", "line 2: count = 'inf': needs a finite number"),
        ("fraction,bin,count\nhard,far,nan\n", "line 2: count = 'nan': needs a finite number"),
        (f"fraction,bin,count\nhard,far,{'9' * 400}\n", "needs a finite number"),
        ("fraction,bin,count\nhard,far,1e13\n", "line 2: count = 10000000000000: must be less than or equal to"),
        (f"fraction,bin,count\nhard,far,{'9' * 140_000}\n", "line 2: field larger than field limit"),
        ("fraction,bin,count\n,far,12\n", "line 2: all fractions in far: a count needs its fraction"),
        ("fraction,bin,share,share\nhard,far,0.1,0.2\n", "head 'share' is there twice"),
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


def test_masses_and_counts_in_several_lines_are_added_up_and_shares_are_not() -> None:
    counts = [Tray(fraction="a", bin=bin_, count=n) for bin_, n in (("near", 30), ("far", 40), ("near", 30))]
    found = Measured.of(counts)
    whole = Measured.of([Tray(fraction="a", bin="near", count=60), Tray(fraction="a", bin="far", count=40)])
    assert found.places == whole.places == (("a", "near"), ("a", "far"))
    np.testing.assert_allclose(found.shares, [0.6, 0.4])
    np.testing.assert_allclose(found.covariance, whole.covariance)
    masses = [Tray(bin="near", mass=2.0, uncertainty=0.3), Tray(bin="far", mass=5.0, uncertainty=0.2),
              Tray(bin="near", mass=3.0, uncertainty=0.4)]  # fmt: skip
    whole = Measured.of([Tray(bin="near", mass=5.0, uncertainty=0.5), masses[1]])
    np.testing.assert_allclose(Measured.of(masses).covariance, whole.covariance)
    shares = [Tray(fraction="a", bin="near", share=share, uncertainty=0.1) for share in (0.5, 0.6)]
    assert list(Measured.of(shares).shares) == [0.5, 0.6]


def test_an_uncertainty_in_percent_beside_a_mass_is_of_that_mass(tmp_path: Path) -> None:
    tray, other = read_trays(written(tmp_path, "bin,mass,uncertainty\nnear,500,10 %\nfar,400,5\n"))
    assert (tray.uncertainty, other.uncertainty) == (pytest.approx(50.0), 5.0)
    table = {"bin": "near", "mass": 500.0, "uncertainty": "10 %"}
    both = [table, {**table, "bin": "far"}]
    assert shipped("vacuum", {"measured": both}).measured[0].uncertainty == pytest.approx(50.0)


def test_columns_are_read_as_a_file_is() -> None:
    whole = {"fraction": np.array(["hard", "hard"]), "bin": ("far", "near"), "count": np.array([5.0, 7.0])}
    assert [tray.count for tray in trays_of_columns({**whole, "uncertainty": [None, float("nan")]})] == [5, 7]
    one = {"fraction": [None], "bin": ["far"], "share": [np.float64(0.1)], "uncertainty": ["2 %"]}
    assert trays_of_columns(one) == [Tray(bin="far", share=0.1, uncertainty=0.02)]
    assert trays_of_columns({**one, "fraction": ["nan"]})[0].fraction == "nan"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"share": [0.5, 1.2]}, "row 2: share = 1.2: write a share from 0 to 1"),
        ({"share": ["120 %", 0.5]}, "row 1: share = '120 %': must be less than or equal to 1"),
        ({"share": [0.5, float("nan")]}, "row 2: is not filled in"),
        ({"shares": [0.5, 0.5]}, "head 'shares' is unknown; did you mean 'share'?"),
        ({"bin": ["far"]}, "columns differ: fraction has 2 cells, bin has 1"),
        ({"share": 0.5}, "column share needs a list of cells"),
        ({"bin": "far"}, "column bin needs a list of cells"),
        ({"fraction": [], "bin": [], "share": [], "uncertainty": []}, "columns hold no tray"),
    ],
)
def test_wrong_columns_are_refused_in_one_line(changes: dict[str, object], message: str) -> None:
    columns = {"fraction": ["hard"] * 2, "bin": ["far"] * 2, "share": [0.5] * 2, "uncertainty": [0.1] * 2}
    with pytest.raises(SceneError, match=r"^measured: ") as caught:
        trays_of_columns({**columns, **changes})
    assert message in str(caught.value)


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
        ([{"bin": "near", "share": 1.2, "uncertainty": 0.1}], "measured[1].share = 1.2: too large (allowed: >= 0 and"),
        ([{"bin": "near", "share": 0.3, "uncertainty": 2.0}], "measured[1]: all fractions in near: uncertainty = 2"),
        ([{"bin": "near", "count": 3}], "a count needs its fraction; give it, or weigh the tray: mass"),
        ([{"fraction": "soft", "bin": "near", "count": 0}], "nothing lay in any tray of it"),
        (
            [{"bin": "near", "mass": 3.0, "uncertainty": 0.1}, {"bin": "far", "share": 0.1, "uncertainty": 0.1}],
            "all trays of it as",
        ),
    ],
)
def test_trays_that_do_not_fit_the_scene_are_refused(trays: list[dict[str, object]], message: str) -> None:
    with pytest.raises(SceneError, match=r"scene: ") as caught:
        shipped("vacuum").replace({"measured": trays})
    assert message in str(caught.value)


@pytest.mark.parametrize(("fraction", "said"), [("soft", "soft: no mass"), (None, "all fractions: no mass")])
def test_masses_are_given_of_every_bin(fraction: str | None, said: str) -> None:
    """The only tray of a fraction would hold all of it, exactly."""
    trays = [{"fraction": fraction, "bin": "near", "mass": 3.0, "uncertainty": 0.1}]
    with pytest.raises(SceneError, match=f"measured: {said} or count in far; give 0 where nothing lay"):
        shipped("vacuum").replace({"measured": [{k: v for k, v in tray.items() if v is not None} for tray in trays]})
