"""From a scene's outlines and a rung to a mesh spec."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..core.errors import SceneError
from ..core.geometry import distance_between, is_symmetric
from .spec import Array, Direction, MeshSpec, SideInlet, Strategy

__all__ = ["plan_mesh"]

# Cell edge over projected body width at the body, its corners, in the near wake and far away. "draft" is meant for
# the half domain and a steady solution; "standard" for a time-resolved one, whose time step the smallest cells dictate;
# "reference" of a scene is that table on three scales (rungs.GRIDS).
RESOLUTION = {
    "draft": {"body": 1 / 60, "corner": 1 / 160, "wake": 1 / 28, "far": 1 / 6, "growth": 0.12},
    "standard": {"body": 1 / 40, "corner": 1 / 80, "wake": 1 / 26, "far": 1 / 5, "growth": 0.13},
}
# over an edge's length, a gap, the channel's width: on short edges, at narrow gaps, far away in a wide channel, and on
# no-slip side walls
SHARES = {"edge": 1 / 6, "gap": 1 / 8, "across": 1 / 40, "wall": 1 / 40}
UPSTREAM, DOWNSTREAM = 3.0, 8.0  # shortest distance from bodies to inlet and outlet, in projected widths


def plan_mesh(
    bodies: Sequence[Array],
    *,
    width: float,
    top: float,
    bottom: float,
    names: Sequence[str] | None = None,
    walls: str = "slip",
    direction: Direction = "down",
    rung: str = "draft",
    scale: float = 1.0,
    inlets: Sequence[SideInlet] = (),
    extend: bool = True,
    half: bool | None = None,
    strategy: Strategy | None = None,
) -> MeshSpec:
    """Choose cell sizes for a rung; ``scale`` multiplies all of them.

    Sizes follow each rung's table from the narrowest body's projected width. With ``extend`` a channel that ends too
    near to the bodies (3 widths upstream, 8 downstream) is meshed longer than it is: the inlet's uniform air and the
    outlet's uniform pressure must not touch the wake; without, exactly the channel given is meshed. ``inlets`` are
    openings in the side walls. ``half`` None: a draft takes the half domain when all bodies are symmetric about x = 0
    and the openings mirror each other; False: the whole channel (for openings whose streams differ). ``strategy`` None:
    the rung's.
    Raises SceneError for bodies that touch each other or a wall, openings outside of the channel or on each other, and
    ``half`` True where there is no symmetry.
    """
    if rung not in RESOLUTION:
        raise SceneError(f"no mesh is planned for rung {rung!r} (known: {', '.join(RESOLUTION)})")
    outlines = [np.asarray(body, dtype=float) for body in bodies]
    _check_places(outlines, width, top, bottom)
    _check_inlets(inlets, top, bottom)
    symmetric = all(is_symmetric(outline) for outline in outlines) and _are_mirrored(inlets)
    if half and not symmetric:
        raise SceneError("the half domain needs bodies and openings that are symmetric about x = 0")
    table = RESOLUTION[rung] | SHARES
    across = [float(np.ptp(outline[:, 0])) for outline in outlines]
    size, largest = min(across), max(across)
    low = min(float(o[:, 1].min()) for o in outlines)
    high = max(float(o[:, 1].max()) for o in outlines)
    before, behind = UPSTREAM * largest, DOWNSTREAM * largest
    above, below = (before, behind) if direction == "down" else (behind, before)
    h_far = scale * max(table["far"] * largest, table["across"] * width)
    return MeshSpec(
        bodies=tuple(tuple((float(x), float(y)) for x, y in outline) for outline in outlines),
        names=tuple(names) if names is not None else tuple(str(i) for i in range(len(outlines))),
        width=width,
        top=max(top, high + above) if extend else top,
        bottom=min(bottom, low - below) if extend else bottom,
        walls="slip" if walls == "slip" else "no-slip",
        direction=direction,
        half=(rung == "draft" and symmetric) if half is None else half,
        h_body=scale * table["body"] * size,
        h_corner=scale * table["corner"] * size,
        h_wake=scale * table["wake"] * size,
        h_far=h_far,
        growth=scale * table["growth"],
        wake_length=2.5 * largest,
        h_wall=min(scale * table["wall"] * width, h_far) if walls == "no-slip" else h_far,
        of_edge=scale * table["edge"],
        of_gap=scale * table["gap"],
        inlets=tuple(inlets),
        strategy=strategy or "quads",
    )


def _check_places(outlines: list[Array], width: float, top: float, bottom: float) -> None:
    for i, outline in enumerate(outlines):
        (left, low), (right, high) = outline.min(axis=0), outline.max(axis=0)
        if left <= -width / 2 or right >= width / 2 or low <= bottom or high >= top:
            raise SceneError(
                f"body {i} spans x {left:g}..{right:g} m, y {low:g}..{high:g} m and must lie inside the channel "
                f"x {-width / 2:g}..{width / 2:g} m, y {bottom:g}..{top:g} m"
            )
        for j, other in enumerate(outlines[:i]):
            if distance_between(outline, other) <= 0:
                raise SceneError(f"bodies {j} and {i} touch each other: move one of them")


def _check_inlets(inlets: Sequence[SideInlet], top: float, bottom: float) -> None:
    for i, inlet in enumerate(inlets):
        if not bottom <= inlet.start < inlet.end <= top:
            raise SceneError(
                f"the opening {inlet.name!r} spans y {inlet.start:g}..{inlet.end:g} m and must rise within the "
                f"channel's {bottom:g}..{top:g} m"
            )
        for other in inlets[:i]:
            if inlet.name == other.name:
                raise SceneError(f"two openings are called {inlet.name!r}: rename one of them")
            if inlet.side == other.side and inlet.start < other.end and other.start < inlet.end:
                raise SceneError(f"the openings {other.name!r} and {inlet.name!r} overlap: move one of them")


def _are_mirrored(inlets: Sequence[SideInlet]) -> bool:
    left, right = ({(i.start, i.end) for i in inlets if i.side == side} for side in ("left", "right"))
    return left == right
