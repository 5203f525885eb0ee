"""What to mesh: everything that decides on the mesh, in plain numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Outline = tuple[tuple[float, float], ...]
Direction = Literal["down", "up"]
Strategy = Literal["quads", "triangles", "layers"]


@dataclass(frozen=True)
class SideInlet:
    """An opening in a side wall of the channel, from y = ``start`` to ``end`` (m): the patch ``inlet_NAME``."""

    name: str
    side: Literal["left", "right"]
    start: float
    end: float

    @property
    def patch(self) -> str:
        """Name of its patch."""
        return f"inlet_{self.name}"


@dataclass(frozen=True)
class MeshSpec:
    """What to mesh: bodies in a vertical channel centred on x = 0, y up, all lengths in metres.

    ``bodies`` are (k, 2) outlines, counter-clockwise; ``names`` name their patches (``body_NAME``). ``half`` meshes x
    >= 0 only. Cell edges, for the narrowest body and in proportion for wider ones: ``h_body`` along the outlines,
    ``h_corner`` at their sharp corners, ``h_wake`` downstream over ``wake_length``; for all: ``h_wall`` on no-slip side
    walls, ``h_far`` at most from y = ``fine``[0] to ``fine``[1] (m), ``h_end`` at most beyond; between them the edge
    grows by ``growth`` metres a metre. On an edge between two sharp corners it is no longer than ``of_edge`` times that
    edge, at a gap between bodies or to a side wall ``of_gap`` times the gap.
    """

    bodies: tuple[Outline, ...]
    names: tuple[str, ...]
    width: float
    top: float
    bottom: float
    walls: Literal["slip", "no-slip"]
    direction: Direction
    half: bool
    h_body: float
    h_corner: float
    h_wake: float
    h_far: float
    growth: float
    wake_length: float
    h_wall: float = float("inf")
    of_edge: float = 1 / 6
    of_gap: float = 1 / 8
    inlets: tuple[SideInlet, ...] = ()
    strategy: Strategy = "quads"
    h_end: float = 0.0  # no more than h_far: the same everywhere
    fine: tuple[float, float] = (-float("inf"), float("inf"))

    @classmethod
    def from_json(cls, table: Mapping[str, Any]) -> MeshSpec:
        """The spec from ``dataclasses.asdict`` of it, as JSON hands it back."""
        bodies = tuple(tuple((float(x), float(y)) for x, y in body) for body in table["bodies"])
        inlets = tuple(SideInlet(**inlet) for inlet in table["inlets"])
        named = {"bodies": bodies, "names": tuple(table["names"]), "inlets": inlets, "fine": tuple(table["fine"])}
        return cls(**{**table, **named})

    @property
    def h_most(self) -> float:
        """The longest cell edge anywhere (m)."""
        return max(self.h_far, self.h_end)

    @property
    def projected_width(self) -> float:
        """Width of the first body across the air (m): the length in Reynolds, Strouhal and drag coefficient."""
        return self.widths[0]

    @property
    def widths(self) -> tuple[float, ...]:
        """Width of every body across the air (m)."""
        return tuple(float(np.ptp(np.array(body)[:, 0])) for body in self.bodies)

    @property
    def thickness(self) -> float:
        """Depth of the single layer of cells (m); nothing depends on it."""
        return 0.2 * self.projected_width

    @property
    def meshed_inlets(self) -> tuple[SideInlet, ...]:
        """The openings that the mesh has: in a half domain those on the right."""
        return tuple(inlet for inlet in self.inlets if not self.half or inlet.side == "right")

    @property
    def patches(self) -> tuple[str, ...]:
        """Names of all boundary patches."""
        sides = ("axis", "right") if self.half else ("left", "right")
        openings = (inlet.patch for inlet in self.meshed_inlets)
        return ("inlet", "outlet", *sides, *openings, *(f"body_{name}" for name in self.names), "front", "back")

    def scaled(self, factor: float) -> MeshSpec:
        """The same spec with the cell edge multiplied by ``factor`` everywhere, growth included (for grid studies)."""
        names = ("h_body", "h_corner", "h_wake", "h_far", "h_end", "h_wall", "growth", "of_edge", "of_gap")
        longer: dict[str, Any] = {name: getattr(self, name) * factor for name in names}
        return replace(self, **longer)
