"""The picture of a feed funnel: the mass that is left in it over time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .canvas import COLOURS, INK, new_figure, save

__all__ = ["draw_discharge"]


def draw_discharge(path: Path | str, poured: Mapping[str, Any]) -> None:
    """Mass left (g) against time since the outlet opened (s), the fitted rate and Beverloo's law; PNG.

    ``poured``: the ``funnel`` table of result.json.
    """
    time, mass = (np.asarray(poured["curve"][key]) for key in ("time", "mass"))
    figure = new_figure(6.4, 4.0)
    axes = figure.add_subplot()
    axes.plot(time, 1e3 * mass, color=COLOURS[0], linewidth=1.8, label="computed bead by bead")
    end = poured["time_to_empty"] or float(time[-1])
    half = float(np.interp(-0.575 * poured["mass"], -mass, time))  # the steady stretch's middle: 42.5 % is out
    for value, style, name in (
        (poured["rate"] and poured["rate"]["value"], "-", "its rate"),
        (poured["beverloo"], "--", "Beverloo, at rest"),
        (poured["beverloo_cone"], ":", "Beverloo with cone factor, at rest"),
    ):
        if value:
            line = 1e3 * (0.575 * poured["mass"] - value * (np.array([0.0, 1.2 * end]) - half))
            label = f"{name}: {1e3 * value:.3g} g/s"
            axes.plot([0.0, 1.2 * end], line, style, color=INK, linewidth=0.9, label=label)
    axes.set_xlim(0.0, 1.15 * end)
    axes.set_ylim(0.0, 1.05e3 * poured["mass"])
    axes.set_xlabel("time since the outlet was opened (s)")
    axes.set_ylabel("mass in the funnel (g)")
    shaken = "at rest" if not poured["gamma"] else f"{poured['frequency']:g} Hz, Gamma {poured['gamma']:g}"
    axes.set_title(f"{poured['beads']} beads, {shaken}", fontsize=10)
    axes.legend(frameon=False, fontsize=8)
    save(figure, path)
