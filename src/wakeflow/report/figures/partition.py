"""The partition figure: which granules go into each product, by size and by terminal velocity (Tromp's curve)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..canvas import MM, new_figure, save
from ..colours import COLOURS, fraction_colours
from .figure import Figure, figures

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ...results.landing_results import PartitionCurve
    from ...scene import Scene
    from ..canvas import Paper
    from ..outcome import Outcome

__all__ = ["draw_partition"]

EMPTY = 0.3  # decades without granules: across them a curve is dotted and has no band
AXES = {"size": (MM, "diameter", "mm"), "terminal velocity": (1.0, "terminal velocity", "m/s")}


def draw_partition(paper: Paper, scene: Scene, curves: Sequence[PartitionCurve]) -> NDArray[Any]:
    """Draw a panel a property and a line a product, with its 95 % band and its cut."""
    kinds = list(dict.fromkeys(curve.by for curve in curves))
    figure = new_figure(0.6 + 4.6 * len(kinds), 3.9, paper)
    panels: NDArray[Any] = figure.subplots(1, len(kinds), squeeze=False, sharey=True)[0]
    colours = _product_colours(scene, curves)
    for axes, kind in zip(panels, kinds, strict=True):
        scale, label, unit = AXES[kind]
        for curve in (one for one in curves if one.by == kind):
            at, colour = scale * np.array(curve.at), colours[curve.product]
            share, low, high = (100 * np.array(ends) for ends in (curve.share, curve.low, curve.high))
            for part in np.split(np.arange(len(at)), np.flatnonzero(np.diff(np.log10(at)) > EMPTY) + 1):
                axes.fill_between(at[part], low[part], high[part], color=colour, alpha=0.2, linewidth=0)
                axes.plot(at[part], share[part], "o-", ms=3, lw=1.2, color=colour)
            axes.errorbar(at, share, [share - low, high - share], fmt="none", ecolor=colour, elinewidth=0.7, alpha=0.5)
            axes.plot(at, share, ":", lw=0.9, color=colour, zorder=1)
            axes.plot([], [], "o-", ms=3, lw=1.2, color=colour, label=_told(curve, scale, unit))
            if curve.cut is not None and curve.cut.value is not None:
                axes.plot([scale * curve.cut.value] * 2, [0.0, 50.0], ":", color=colour, linewidth=1.0)
        for level in (25.0, 50.0, 75.0):
            axes.axhline(level, color="#9aa3ad", linewidth=0.5, zorder=0)
        axes.set_xscale("log")
        axes.set_ylim(-2.0, 102.0)
        axes.set_xlabel(f"{label} ({unit})")
        axes.legend(fontsize=7, frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    panels[0].set_ylabel("share of its mass in the product (%)")
    save(figure, paper, _columns(curves))
    return panels


def _product_colours(scene: Scene, curves: Sequence[PartitionCurve]) -> dict[tuple[str, ...], str]:
    """That of the fraction which should land in a product; of a bin that is nobody's target one of its own."""
    own = fraction_colours(list(scene.fraction))
    wanted = {fraction.targets: own[name] for name, fraction in scene.fraction.items()}
    products = list(dict.fromkeys(curve.product for curve in curves))
    return {product: wanted.get(product, COLOURS[i % len(COLOURS)]) for i, product in enumerate(products)}


def _told(curve: PartitionCurve, scale: float, unit: str) -> str:
    name = " or ".join(curve.product)
    if curve.cut is None or curve.cut.value is None:
        return f"{name}: {curve.why}"
    sharp = "" if curve.ep is None else f", Ep {scale * curve.ep:.3g} {unit}, I {curve.imperfection:.2g}"
    return f"{name}: cut {scale * curve.cut.value:.3g} {unit}{sharp}"


def _columns(curves: Sequence[PartitionCurve]) -> dict[str, ArrayLike]:
    sizes = [len(curve.at) for curve in curves]
    names = (" or ".join(curve.product) for curve in curves)
    found: dict[str, ArrayLike] = {
        "product": np.repeat(list(names), sizes),
        "by": np.repeat([curve.by for curve in curves], sizes),
        "unit": np.repeat([curve.unit for curve in curves], sizes),
    }
    for head, key in (
        ("value", "at"), ("mass of the feed (1)", "mass"), ("share (1)", "share"), ("low (1)", "low"),
        ("high (1)", "high"),
    ):  # fmt: skip
        found[head] = np.concatenate([np.array(getattr(curve, key)) for curve in curves])
    return found


def _curves(outcome: Outcome) -> Sequence[PartitionCurve]:
    landings = outcome.result.landings
    return () if landings is None else landings.separation.cut


figures.add(
    "partition",
    Figure(
        "Partition curves: of granules alike in size or terminal velocity, the share in each product; bands: 95 %, of "
        "the finite number of granules alone; dotted where nothing is fed.",
        lambda paper, outcome: draw_partition(paper, outcome.scene, _curves(outcome)),
        lambda outcome: bool(_curves(outcome)),
    ),
)
