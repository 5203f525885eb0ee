"""Size distributions: quantiles by mass, published checks, and what scenes may and may not say."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from wakeflow.core.errors import SceneError
from wakeflow.laws.drag import drag_laws
from wakeflow.laws.size import sizes
from wakeflow.scene import Scene

SIEVES = {"diameters": [1e-5, 4e-5, 8e-5, 2e-4, 4e-4], "passing": [0.0, 0.25, 0.6, 0.6, 1.0]}
PARAMETERS = {
    "single": {"diameter": 1e-3},
    "uniform": {"low": 1e-3, "high": 2e-3},
    "normal": {"mean": 1e-3, "std": 2e-4},
    "lognormal": {"median": 1e-3, "geometric_std": 1.5},
    "rosin-rammler": {"scale": 4e-5, "spread": 1.4},
    "table": SIEVES,
}
EVENLY = (np.arange(200_000) + 0.5) / 200_000


@pytest.mark.parametrize("name", list(sizes))
def test_quantiles_increase_and_stay_positive(name: str) -> None:
    diameters = sizes[name](np.linspace(0.001, 0.999, 999), **PARAMETERS[name])
    assert np.all(diameters > 0)
    assert np.all(np.diff(diameters) >= 0)
    far = sizes[name](np.array([1e-12, 1.0 - 1e-12]), **PARAMETERS[name])
    assert np.all(np.isfinite(far) & (far > 0))


def test_moments_are_the_ones_asked_for() -> None:
    normal = sizes["normal"](EVENLY, mean=1e-3, std=2e-4)
    assert normal.mean() == pytest.approx(1e-3, rel=1e-4)
    assert normal.std() == pytest.approx(2e-4, rel=1e-3)
    log = np.log(sizes["lognormal"](EVENLY, median=1e-3, geometric_std=1.5))
    assert np.exp(log.mean()) == pytest.approx(1e-3, rel=1e-6)
    assert np.exp(log.std()) == pytest.approx(1.5, rel=1e-3)
    with pytest.raises(SceneError, match="below zero"):
        sizes["normal"](EVENLY, mean=1e-3, std=1e-3)


def test_rosin_rammler_passes_63_percent_at_its_scale_and_has_weibulls_mean() -> None:
    quantile = sizes["rosin-rammler"]
    assert quantile(1 - math.exp(-1), scale=4e-5, spread=2.7, low=0.0) == pytest.approx(4e-5, rel=1e-14)
    for spread in (0.8, 1.0, 2.5):
        mean = quantile(EVENLY, scale=1e-3, spread=spread, low=0.0).mean()
        assert mean == pytest.approx(1e-3 * math.gamma(1 + 1 / spread), rel=2e-4)


def test_cut_rosin_rammler_keeps_to_its_cuts_and_to_its_shape() -> None:
    low, high = 1e-5, 6e-5
    d = sizes["rosin-rammler"](EVENLY, scale=4e-5, spread=1.4, low=low, high=high)
    assert low <= d.min()
    assert d.max() <= high
    passing = 1 - np.exp(-((np.array([low, 3e-5, high]) / 4e-5) ** 1.4))
    wanted = (passing[1] - passing[0]) / (passing[2] - passing[0])
    assert np.mean(d < 3e-5) == pytest.approx(wanted, abs=1e-5)
    tail = sizes["rosin-rammler"](1 - 1e-9, scale=4e-5, spread=0.3, low=0.0)  # uncut it has its whole tail
    assert tail == pytest.approx(4e-5 * (9 * math.log(10)) ** (1 / 0.3), rel=1e-6)
    assert sizes["rosin-rammler"](1e-12, scale=4e-5, spread=0.5) == pytest.approx(1e-9, rel=1e-6)  # no atoms
    ends = sizes["rosin-rammler"](np.array([0.0, 1.0]), scale=4e-5, spread=1.4, low=low, high=high)
    np.testing.assert_allclose(ends, [low, high], rtol=1e-12)


def test_sieve_table_gives_back_its_mass_fractions() -> None:
    d = sizes["table"](EVENLY, **SIEVES)
    for sieve, passing in zip(SIEVES["diameters"], SIEVES["passing"], strict=True):
        assert np.mean(d <= sieve * (1 + 1e-12)) == pytest.approx(passing, abs=1e-5)
    assert not np.any((d > 8.0001e-5) & (d < 1.9999e-4))  # a plateau: nothing between those sieves
    assert np.mean(d < 2e-5) == pytest.approx(0.125, abs=1e-5)  # half of a step in log d
    np.testing.assert_allclose(sizes["table"](np.array([0.0, 1.0]), **SIEVES), [1e-5, 4e-4], rtol=1e-12)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ({"distribution": "rosin-rammler", "scale": "40 um"}, "lacks spread"),
        ({"distribution": "rosin-rammler", "scale": "40 um", "spread": 0}, "spread"),
        ({"distribution": "rosin-rammler", "scale": 4e-5, "spread": 1, "low": 2e-5, "high": 1e-5}, "must be below"),
        ({"distribution": "rosin-rammler", "scale": 4e-5, "spread": 40, "low": 2e-4}, "widen them"),
        ({"distribution": "rosin-rammler", "scale": 1e-9, "spread": 50, "low": 0.05}, "widen them"),
        ({"distribution": "rosin-rammler", "scale": 4e-5, "spread": 50, "high": 2e-5}, "widen them"),
        ({"distribution": "table", "diameters": ["40 um"], "passing": [1.0]}, "two at least"),
        ({"distribution": "table", "diameters": [1e-5, 2e-5], "passing": [0, 0.5, 1]}, "must pair up"),
        ({"distribution": "table", "diameters": [2e-5, 1e-5], "passing": [0, 1]}, "diameters must increase"),
        ({"distribution": "table", "diameters": [1e-5, 1e-5, 2e-5], "passing": [0, 0.5, 1]}, "must increase"),
        ({"distribution": "table", "diameters": [1e-5, 2e-5, 3e-5], "passing": [0, 0.7, 0.6]}, "must begin with 0"),
        ({"distribution": "table", "diameters": [1e-5, 2e-5], "passing": [0.1, 1]}, "must begin with 0"),
        (
            {"distribution": "table", "diameters": [1e-5, 2e-5, 3e-5, 4e-5], "passing": [0, 0.7, 0.6, 1]},
            "must not decrease",
        ),
        ({"distribution": "table", "diameters": [1e-5, 2e-5], "passing": [0, 100]}, "passing"),
    ],
)
def test_scenes_refuse_what_is_no_distribution(rhombus: Scene, size: dict[str, object], message: str) -> None:
    with pytest.raises(SceneError, match=message):
        rhombus.replace({"fraction.dust.size": size})


def test_percent_are_not_taken_for_fractions() -> None:
    with pytest.raises(SceneError, match="fractions, not percent"):
        sizes["table"](EVENLY, diameters=[1e-5, 2e-5], passing=[0.0, 100.0])


def test_scenes_take_units_and_lists_and_save_them(rhombus: Scene, tmp_path: Path) -> None:
    sieves = {"distribution": "table", "diameters": ["10 um", "40 um", 1e-4], "passing": [0, 0.4, 1]}
    scene = rhombus.replace(
        {
            "fraction.dust.size": {"distribution": "rosin-rammler", "scale": "40 um", "spread": 1.4, "high": "0.2 mm"},
            "fraction.chaff.size": sieves,
        }
    )
    scene.save(tmp_path / "scene.toml")
    again = Scene.load(tmp_path / "scene.toml")
    p = np.linspace(0.01, 0.99, 50)
    dust = sizes["rosin-rammler"](p, scale=4e-5, spread=1.4, high=2e-4)
    np.testing.assert_allclose(again.fraction["dust"].diameters(p), dust, rtol=1e-12)
    chaff = sizes["table"](p, diameters=[1e-5, 4e-5, 1e-4], passing=[0, 0.4, 1])
    np.testing.assert_allclose(again.fraction["chaff"].diameters(p), chaff, rtol=1e-12)
    wider = scene.replace({"fraction.dust.size.spread": 2.0}).fraction["dust"].diameters(p)
    np.testing.assert_allclose(wider, sizes["rosin-rammler"](p, scale=4e-5, spread=2.0, high=2e-4), rtol=1e-12)


def test_the_schema_names_every_distribution_and_the_drag_laws() -> None:
    text = json.dumps(Scene.model_json_schema(by_alias=True))
    for name in (*sizes, *drag_laws):
        assert name in text


def test_a_fraction_chooses_its_drag_law(rhombus: Scene) -> None:
    assert rhombus.fraction["wheat"].drag_law == "brown-lawler"
    assert rhombus.replace({"fraction.wheat.sphericity": 0.8}).fraction["wheat"].drag_law == "haider-levenspiel"
    chosen = rhombus.replace({"fraction.wheat.sphericity": 0.8, "fraction.wheat.drag": "ganser"})
    assert chosen.fraction["wheat"].drag_law == "ganser"
    assert rhombus.replace({"fraction.wheat.drag": "putnam"}).fraction["wheat"].drag_law == "putnam"
    with pytest.raises(SceneError, match=r"unknown drag law 'gansr'.*did you mean"):
        rhombus.replace({"fraction.wheat.drag": "gansr"})
    with pytest.raises(SceneError, match="'ganser' needs a sphericity"):
        rhombus.replace({"fraction.wheat.drag": "ganser"})
    with pytest.raises(SceneError, match="'putnam' has no sphericity"):
        rhombus.replace({"fraction.wheat.sphericity": 0.8, "fraction.wheat.drag": "putnam"})
