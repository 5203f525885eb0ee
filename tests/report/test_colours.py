"""Fractions keep their colours, and the colours are seen apart with any kind of colour vision."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from wakeflow.laws.material import materials
from wakeflow.report.canvas import COLOURS, KNOWN, fraction_colours
from wakeflow.report.many import _looks
from wakeflow.scene import Scene

VISIONS = ("normal", "protanomaly", "deuteranomaly", "tritanomaly")
SHIPPED = ("rhombus", "prism", "labyrinth", "aspirator")
APART, SHIPPED_APART = 9.0, 14.0  # CAM02-UCS (Luo, Cui & Li 2006): 1 is just seen; side by side 10 are another colour


def _difference(one: str, other: str, vision: str) -> float:
    """Of two colours as they are seen with a lack of one kind of cone (Machado, Oliveira & Fernandes 2009)."""
    from colorspacious import cspace_convert, deltaE

    seen = [np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255 for colour in (one, other)]
    if vision != "normal":
        space = {"name": "sRGB1+CVD", "cvd_type": vision, "severity": 100}
        seen = [np.clip(cspace_convert(colour, space, "sRGB1"), 0.0, 1.0) for colour in seen]
    return float(deltaE(*seen, input_space="sRGB1"))


@pytest.mark.parametrize("vision", VISIONS)
def test_any_two_colours_are_seen_apart(vision: str) -> None:
    assert min(_difference(one, other, vision) for one, other in itertools.combinations(COLOURS, 2)) > APART


@pytest.mark.parametrize("name", SHIPPED)
def test_the_fractions_of_shipped_scenes_are_far_apart(name: str, cases: Path) -> None:
    colours = fraction_colours(list(Scene.load(cases / f"{name}.toml").fraction)).values()
    pairs = itertools.combinations(colours, 2)
    assert min(_difference(one, other, vision) for one, other in pairs for vision in VISIONS) > SHIPPED_APART


def test_a_fraction_keeps_its_colour_whatever_is_fed_with_it() -> None:
    for name in materials:
        alone = fraction_colours([name])[name]
        assert fraction_colours(["weed", name, "grit"])[name] == alone or name not in KNOWN
    assert fraction_colours(["weed"])["weed"] == fraction_colours(["wheat", "weed"])["weed"]


def test_up_to_nine_fractions_have_nine_colours() -> None:
    names = [f"sieve-{i}" for i in range(len(COLOURS) - 1)]
    found = fraction_colours(["wheat", *names])
    assert list(found) == ["wheat", *names]  # in the order asked for
    assert len(set(found.values())) == len(COLOURS)
    assert set(fraction_colours([f"f{i}" for i in range(20)]).values()) == set(COLOURS)


def test_figures_of_many_runs_colour_quantities_by_their_fraction() -> None:
    recoveries = ["recovery.straw", "recovery.wheat", "recovery.own"]
    colours = fraction_colours(["straw", "wheat", "own"]).values()
    assert [look.colour for look in _looks(recoveries).values()] == list(colours)
    assert _looks(["purity.left.chaff"])["purity.left.chaff"].colour == KNOWN["chaff"]
    left, right, chaff = _looks(["share.wheat.left", "share.wheat.right", "share.chaff.left"]).values()
    assert left.colour == right.colour != chaff.colour
    assert left.marker != right.marker
