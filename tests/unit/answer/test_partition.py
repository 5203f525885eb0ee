"""Partition curves, and dividers between two bins."""

import copy
import itertools
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

import wakeflow as wf
from support import ALONE, landings_in, shipped
from wakeflow.answer.draws import ErrorSource
from wakeflow.answer.partition import partition_curves
from wakeflow.answer.separation import joint_answer
from wakeflow.cli import main
from wakeflow.core.errors import SceneError
from wakeflow.core.number import Number
from wakeflow.extras.dividers.bin_commands import show_dividers
from wakeflow.extras.dividers.dividers import Landed1D, best_stretches, cut, dividers, landed_along, purities, trade_off
from wakeflow.flight.stages.landings import Landings
from wakeflow.laws.constants import STANDARD_AIR
from wakeflow.laws.drag import drag_laws, terminal_velocity
from wakeflow.planning.uniform_fall import settling_velocities
from wakeflow.runs.planned import make_plan
from wakeflow.scene import Scene

SIZES, SHARPNESS = (1e-3, 4e-3), 12.0  # m; of the logistic curve in ln(x / x50)
CUT = 2.2e-3  # m
EP = CUT * np.sinh(np.log(3.0) / SHARPNESS)  # exact: x75 and x25 are CUT times 3^(+-1/SHARPNESS)


@pytest.fixture
def scene(cases: Path) -> Scene:
    return Scene.load(cases / "vacuum.toml").replace({
        "fraction.soft.mass_share": 0.3, "fraction.hard.mass_share": 0.7,
        "fraction.soft.target": "near", "fraction.hard.target": "far",
    })  # fmt: skip


def _landings(scene: Scene, seed: int, count: int = 16384, drag: float | None = 1.0) -> dict[str, Landings]:
    """Sizes even in their logarithm; what is larger than about CUT goes into the second bin."""
    found, rng = {}, np.random.default_rng(seed)
    for name in scene.fraction:
        size = np.exp(rng.uniform(*np.log(SIZES), count))
        bins = (rng.random(count) < expit(SHARPNESS * np.log(size / CUT))).astype(np.int16)
        found[name] = landings_in(bins, diameter=size, drag=None if drag is None else np.full(count, drag))
    return found


def test_a_known_curve_is_found_with_its_cut_and_sharpness(scene: Scene) -> None:
    curves = partition_curves(scene, make_plan(scene), _landings(scene, 1))
    assert [(curve.product, curve.by) for curve in curves] == [
        (("near",), "size"), (("near",), "terminal velocity"), (("far",), "size"), (("far",), "terminal velocity"),
    ]  # fmt: skip
    far = curves[2]
    assert far.cut.value == pytest.approx(CUT, rel=0.02)
    assert far.ep == pytest.approx(EP, rel=0.1)
    assert far.imperfection == pytest.approx(far.ep / far.cut.value)
    exact = expit(SHARPNESS * np.log(np.array(far.at) / CUT))
    assert np.abs(np.array(far.share) - exact).max() < 0.05
    assert sum(far.mass) == pytest.approx(1.0)
    near = curves[0]
    assert np.array(near.share) + np.array(far.share) == pytest.approx(1.0)
    assert near.cut.value == pytest.approx(far.cut.value)


def test_bands_hold_the_truth_as_often_as_they_say(scene: Scene) -> None:
    plan, inside, cuts = make_plan(scene), [], []
    for seed in range(40):
        far = partition_curves(scene, plan, _landings(scene, seed, 2048, None))[1]
        exact = expit(SHARPNESS * np.log(np.array(far.at) / CUT))
        inside.append(np.mean((exact >= far.low) & (exact <= far.high)))
        assert far.cut.high is not None
        cuts.append(far.cut.low <= CUT <= far.cut.high)
    assert 0.9 < np.mean(inside) <= 1.0
    assert np.mean(cuts) > 0.85


def test_what_is_not_known_of_the_shares_is_in_the_band_and_the_cut(scene: Scene) -> None:
    """A joint answer of one error, which moves granules between the two bins: every class is shifted alike."""
    landings, plan = _landings(scene, 5, drag=None), make_plan(scene)
    roots = np.zeros((2, len(scene.bin) + 1, 1))
    roots[:, 0, 0], roots[:, 1, 0] = 0.1, -0.1  # standard deviations of the shares
    answer = joint_answer(scene, landings, sources=[ErrorSource("wake", roots, together=True)]).own
    alone, far = partition_curves(scene, plan, landings)[1], partition_curves(scene, plan, landings, answer)[1]
    assert (far.share, far.cut.value) == (alone.share, alone.cut.value)
    steep = np.array(far.share)
    assert np.all(np.array(far.high) - far.low >= np.array(alone.high) - alone.low - 1e-12)
    middle = int(np.argmin(np.abs(steep - 0.5)))  # most where the curve is steep
    assert far.high[middle] - far.low[middle] > 0.5 > alone.high[middle] - alone.low[middle]
    # As many granules as change bins lie between the two cuts: sizes are even in their logarithm
    moved = 1.959964 * 0.1 * np.log(SIZES[1] / SIZES[0])
    assert np.log(far.cut.high / far.cut.value) == pytest.approx(moved, rel=0.1)
    assert np.log(far.cut.value / far.cut.low) == pytest.approx(moved, rel=0.1)
    assert far.cut.half > 5.0 * alone.cut.half


def test_a_product_that_takes_little_of_every_class_has_no_cut(scene: Scene) -> None:
    landings = _landings(scene, 3, drag=None)
    for landing in landings.values():
        landing.bin[:] = np.where(np.arange(len(landing.bin)) % 5 == 0, 0, 1)
    near = partition_curves(scene, make_plan(scene), landings)[0]
    assert near.cut is None
    assert near.ep is None
    assert near.why == "less than a half of every class"


def test_a_gap_between_the_fractions_is_told_in_millimetres(scene: Scene) -> None:
    landings = _landings(scene, 3, drag=None)
    for place, (landing, size) in enumerate(zip(landings.values(), (58e-6, 1.3e-3), strict=True)):
        landing.diameter[:] = size
        landing.bin[:] = place
    near = partition_curves(scene, make_plan(scene), landings)[0]
    assert near.cut is not None
    assert near.why == "no granules between 0.058 and 1.3 mm"


def test_granules_that_are_all_alike_have_no_curve(scene: Scene) -> None:
    landings = _landings(scene, 3)
    for landing in landings.values():
        landing.diameter[:] = 2e-3
    by = {curve.by for curve in partition_curves(scene, make_plan(scene), landings)}
    assert by == {"terminal velocity"}  # the fractions' densities differ


@pytest.mark.parametrize("law", ["brown-lawler", "haider-levenspiel"])
def test_terminal_velocities_from_the_table_are_the_roots(law: str) -> None:
    diameter = np.geomspace(1e-6, 2e-2, 50)
    drag = np.linspace(0.6, 1.7, 50)
    shape = 0.8 if drag_laws[law].uses_sphericity else 1.0
    found = settling_velocities(diameter, 1300.0, drag, law, shape, STANDARD_AIR)
    exact = terminal_velocity(diameter, 1300.0, *STANDARD_AIR, law=law, sphericity=shape, drag_scale=drag)
    assert found == pytest.approx(exact, rel=1e-5)
    assert np.isnan(settling_velocities(diameter, 1.0, drag, law, shape, STANDARD_AIR)).all()


LINE = np.array([[0.0, 0.0], [1.0, 0.0]])


def _landed(seed: int, count: int, *, two_sided: bool = False) -> Landed1D:
    """Wanted granules about 0.6 (and 0.2), others about 0.4."""
    rng = np.random.default_rng(seed)
    wanted = rng.random(count) < 0.5
    middle = np.where(wanted, np.where(two_sided & (rng.random(count) < 0.5), 0.2, 0.6), 0.4)
    place = np.clip(middle + 0.1 * rng.standard_normal(count), 0.0, 1.0)
    return Landed1D(place, np.where(wanted, 2.0, 1.0) / count, wanted, 0.0, LINE)


def _held(landed: Landed1D, stretches: list[tuple[float, float]]) -> tuple[float, float]:
    """Wanted mass inside, and its part of all mass inside."""
    inside = np.zeros(len(landed.place), dtype=bool)
    for low, high in stretches:
        inside |= (landed.place >= low) & (landed.place <= high)
    own = float(landed.mass[inside & landed.wanted].sum())
    return own, own / float(landed.mass[inside].sum()) if inside.any() else 0.0


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("stretches", [1, 2])
def test_nothing_holds_more_at_the_purity(seed: int, stretches: int) -> None:
    landed, purity = _landed(seed, 14, two_sided=stretches == 2), 0.85
    own, pure = _held(landed, list(best_stretches(landed, purity, stretches)))
    assert pure >= purity - 1e-12
    edges = np.concatenate([[0.0], 0.5 * (np.sort(landed.place)[1:] + np.sort(landed.place)[:-1]), [1.0]])
    best = 0.0
    for places in itertools.combinations(edges, 2 * stretches):
        held, part = _held(landed, list(zip(places[::2], places[1::2], strict=True)))
        best = max(best, held if part >= purity - 1e-12 else 0.0)
    assert own == pytest.approx(best)


def test_no_stretch_is_said_to_reach_what_none_does() -> None:
    landed = _landed(0, 200)._replace(wanted=np.arange(200) % 2 == 0)  # mixed through and through
    landed = landed._replace(mass=np.ones(200), place=np.repeat(np.linspace(0.1, 0.9, 100), 2))
    assert best_stretches(landed, 0.9, 1) == ()
    assert best_stretches(landed, 0.9, 2) == ()


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> wf.Result:
    scene = shipped("rhombus", {"numerics.rung": "none", "feed.count": 2048, "fraction.wheat.restitution": 0.3})
    return wf.run(scene, tmp_path_factory.mktemp("bins"), force=ALONE, report=False)


def test_dividers_of_a_run_are_judged_on_other_granules(run: wf.Result) -> None:
    found = wf.dividers(run, "wheat", 0.97, stretches=2)
    assert found.possible
    landed = landed_along(run, "wheat", "floor")
    assert _held(landed, list(found.stretches))[1] >= 0.97 - 1e-9
    assert found.purity.low <= found.purity.value <= found.purity.high
    assert found.purity.high >= 0.97 - 0.02
    one = wf.dividers(run, "wheat", 0.97)
    assert _held(landed, list(one.stretches))[0] <= _held(landed, list(found.stretches))[0]


def test_a_purity_in_percent_is_a_share(run: wf.Result) -> None:
    assert wf.dividers(run, "wheat", "97 %").asked == 0.97
    assert wf.dividers(run, "wheat", "97%").stretches == wf.dividers(run, "wheat", 0.97).stretches


def test_a_stretch_is_the_bin_that_a_new_run_would_have(run: wf.Result, tmp_path: Path) -> None:
    """Bins of the dividers, flown anew, hold what the dividers promised."""
    found = wf.dividers(run, "wheat", 0.97)
    (low, high) = found.stretches[0]
    half = wf.Scene.parse(run.scene).channel.width / 2
    assert [x for x, _ in cut(found.line, low, high)] == pytest.approx([low - half, high - half])
    tables = {**copy.deepcopy(run.scene), "bin": {"product": {"from": low - half, "to": high - half}}}
    for fraction in tables["fraction"].values():
        fraction.pop("target", None)
    tables["fraction"]["wheat"]["target"] = "product"
    again = wf.run(wf.Scene.parse(tables), tmp_path, force=ALONE, report=False).landings.separation
    pure, recovery = again.purity["product"]["wheat"], again.recovery["wheat"]
    assert pure.low <= found.purity.high
    assert found.purity.low <= pure.high
    assert recovery.low <= found.recovery.high
    assert found.recovery.low <= recovery.high


def test_the_curve_falls_and_says_where_it_ends(run: wf.Result, capsys: pytest.CaptureFixture[str]) -> None:
    levels = purities(run, "wheat")
    curve = trade_off(run, "wheat", levels[::4])
    landed = landed_along(run, "wheat", "floor")
    held = [_held(landed, list(one.stretches))[0] if one.possible else 0.0 for one in curve]
    assert held == sorted(held, reverse=True)
    assert main(["bins", str(run.folder), "--purity", "wheat=0.97"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"\[bin.wheat-1\]\nfrom = \"-?[\d.]+ mm\"\nto = \"-?[\d.]+ mm\"\n", out)
    assert "less pure" not in out
    poor = replace(dividers(run, "wheat", 0.97), purity=Number(0.93, 0.91, 0.95))
    show_dividers([poor], "floor")
    assert "less pure than the 97 % asked for" in capsys.readouterr().out
    assert main(["bins", str(run.folder), "--purity", "wheat"]) == 0
    assert (run.folder / "figures" / "bins-wheat-floor.png").exists()
    assert len((run.folder / "bins-wheat-floor.csv").read_text().splitlines()) == len(levels) + 1


def test_damaged_landings_are_said_with_their_cure(run: wf.Result, tmp_path: Path) -> None:
    shutil.copy(run.folder / "result.json", tmp_path)
    with pytest.raises(wf.SceneError, match="the run ended before its tracks"):
        landed_along(tmp_path, "wheat", "floor")
    (tmp_path / "granules.npz").write_bytes(b"PK no more")
    with pytest.raises(wf.SceneError, match="damaged; wakeflow report"):
        landed_along(tmp_path, "wheat", "floor")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fraction": "weat"}, "did you mean 'wheat'"),
        ({"purity": 1.0}, "above 0 and below 1"),
        ({"purity": "most"}, "purity = 'most': needs a share"),
        ({"purity": None}, "purity = None: a number such as 0.01"),
        ({"stretches": 0}, "at least 1"),
        ({"stretches": 51}, "at most 50"),
        ({"on": "flor"}, "did you mean 'floor'"),
        ({"on": "top"}, "no granule of wheat landed on top"),
    ],
)
def test_wrong_questions_are_one_line(run: wf.Result, options: dict[str, object], message: str) -> None:
    asked = {"fraction": "wheat", "purity": 0.97, **options}
    with pytest.raises(SceneError, match=message):
        wf.dividers(run, **asked)


def test_places_along_a_bent_line() -> None:
    bent = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    assert cut(bent, 0.5, 2.0) == [(0.5, 0.0), (1.0, 0.0), (1.0, 1.0)]
