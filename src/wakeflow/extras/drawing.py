"""A body's outline out of a drawing: a DXF file with one closed outline of lines, polylines, arcs and curves.

Comes in: the name of a file, the unit of its numbers, a layer of it. Goes out: the corners of the outline.
May call it: nobody by name; ``scene.user_files`` has the registry of drawings.
"""

from __future__ import annotations

import io
import logging
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..core.errors import SceneError
from ..core.files import read_whole, user_path
from ..core.quantities import quantity
from ..core.registry import did_you_mean
from ..scene.user_files import DXF, drawings

if TYPE_CHECKING:
    from ezdxf.document import Drawing
    from ezdxf.entities.dxfentity import DXFEntity

Array = NDArray[np.float64]
DRAWN = ("LINE", "LWPOLYLINE", "POLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE")  # what an outline is drawn with
SILENT = ("TEXT", "MTEXT", "DIMENSION", "POINT", "VIEWPORT", "LEADER", "MULTILEADER")  # what explains a drawing
UNITS = {  # of $INSUNITS; others are not a machine's
    1: "inch", 2: "foot", 4: "mm", 5: "cm", 6: "m", 8: "uinch", 9: "thou", 10: "yard", 13: "um", 14: "dm",
}  # fmt: skip
DEEP = 16  # blocks in each other that are read; one in itself has no end
ROUND = 2e-4  # of the outline's extent: how far the corners that stand for an arc leave it
MEETS = 1e-4  # of the outline's extent: ends nearer than that are one corner


def read_outline(file: str, base: Path, unit: object = None, layer: object = None) -> list[list[float]]:
    """Corners (m), in the drawing's own frame, of the one closed outline in the model space of a DXF ``file``, its path
    relative to ``base``, on one ``layer`` of it or on all; what is hidden, or on a layer that is off or frozen, is not
    there, and blocks are what they hold. ``unit`` of its numbers, such as "mm": by default the drawing's own
    ($INSUNITS). Arcs become corners within 2e-4 of the extent; z, texts and dimensions do not count.

    Raises SceneError, one line, where the file is no drawing, has no unit, or more or less than one closed outline.
    """
    say = f"outline = {file!r}"
    path = user_path(file, base, "outline")
    try:
        text = read_whole(path).decode("latin-1")  # names of layers do not count
    except OSError as problem:
        raise SceneError(f"{say}: {problem.strerror}: {path}") from None
    try:
        from ezdxf.filemanagement import read
        from ezdxf.lldxf.const import DXFError
    except ImportError:
        raise SceneError(f"{say}: reading it needs ezdxf: pip install ezdxf, or sh cases/setup.sh") from None
    logging.getLogger("ezdxf").setLevel(logging.CRITICAL)  # it tells what it mends, with the file's own letters
    try:
        with np.errstate(all="ignore"):
            drawing = read(io.StringIO(text, newline=None))
            result = _joined(_lines_of(_seen(drawing, layer, say), say))
    except SceneError:
        raise
    except (DXFError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as problem:
        raise SceneError(f"{say}: is no DXF drawing in text that can be read ({problem}); save it again") from None
    scale = _metres(unit, drawing.units if "$INSUNITS" in text else 0, say)  # ezdxf takes metres where it is missing
    corners: list[list[float]] = (scale * _only(result, say)).tolist()
    return corners


def _seen(drawing: Drawing, layer: object, say: str) -> Iterator[DXFEntity]:
    """What a draughtsman sees of a drawing, on one ``layer`` of it where one is named; blocks as what they hold."""
    from ezdxf.entities.insert import Insert

    hidden = {item.dxf.name.lower() for item in drawing.layers if item.is_off() or item.is_frozen()}
    names = sorted({item.dxf.name for item in drawing.layers})
    if layer is not None and str(layer).lower() not in map(str.lower, names):
        raise SceneError(
            f"{say}: outline_layer = {layer!r}{did_you_mean(str(layer), names)} (it has {', '.join(names)})"
        )
    waiting: list[tuple[DXFEntity, str, int]] = [(item, "0", 0) for item in reversed(list(drawing.modelspace()))]
    while waiting:
        item, block, depth = waiting.pop()
        if depth > DEEP:
            raise SceneError(f"{say}: holds blocks in each other, deeper than {DEEP}; explode them")
        on_layer = str(item.dxf.get("layer", "0")).lower()
        on_layer = block if on_layer == "0" else on_layer  # as the block that it is in lies
        if on_layer in hidden or item.dxf.get("invisible", 0):
            continue
        if isinstance(item, Insert):
            waiting += [(i, on_layer, depth + 1) for part in item.multi_insert() for i in part.virtual_entities()]
        elif layer is None or on_layer == str(layer).lower():
            yield item


def _metres(unit: object, coded: int, say: str) -> float:
    """Metres in one unit of a drawing."""
    name = UNITS.get(coded) if unit is None else unit
    if not isinstance(name, str):
        raise SceneError(f'{say}: does not say its unit; write outline_unit = "mm" below it')
    try:
        return quantity(f"1 {name}", "m", "1 mm")
    except ValueError as problem:
        raise SceneError(f"outline_unit = {unit!r}: {problem}") from None


def _lines_of(entities: Iterable[DXFEntity], say: str) -> list[Array]:
    """Points (k, 2) of every line of a drawing, in its unit, from one end to the other."""
    from ezdxf.path import make_path

    paths = []
    for item in entities:
        kind = item.dxftype()
        if kind in SILENT:
            continue
        if kind not in DRAWN:
            raise SceneError(f"{say}: holds a {kind}; explode it into lines and arcs, or delete it")
        paths.append(make_path(item))
    ends = np.array([(p.x, p.y) for path in paths for p in path.control_vertices()] or [(0.0, 0.0)])
    extent = float(np.ptp(ends, axis=0).max())
    if not 0.0 < extent < math.inf:
        raise SceneError(f"{say}: no closed outline in it; draw one, in the model space")
    if any(np.ptp([p.z for p in path.control_vertices()] or [0.0]) > MEETS * extent for path in paths):
        raise SceneError(f"{say}: a line of it does not lie in the plane of x and y; turn the drawing into that plane")
    return [np.array([(p.x, p.y) for p in path.flattening(ROUND * extent)]) for path in paths if len(path)]


def _joined(lines: list[Array]) -> tuple[list[Array], int]:
    """The closed outlines (k, 2) that lines make whose ends meet, each without its last point again, and how many lines
    are left open.
    """
    near = MEETS * float(np.ptp(np.concatenate(lines), axis=0).max())
    closed, free, ends = [], _FreeEnds(lines, near), 0
    for number in reversed(range(len(lines))):
        if number not in free.lines:
            continue
        parts = [free.take(number)]
        start, end = parts[0][0], parts[0][-1]
        while math.dist(start, end) > near and (met := free.meeting(end)):
            line = free.take(met[0][0])[:: -1 if met[0][1] else 1]
            parts.append(line[1:])
            end = line[-1]
        chain = np.concatenate(parts)
        apart = np.hypot(*np.diff(chain, axis=0, append=chain[:1]).T) > near
        if math.dist(start, end) <= near and apart.sum() >= 3:
            closed.append(chain[apart])
        else:
            ends += 1
    return closed, ends


class _FreeEnds:
    """The ``lines`` that are in no chain yet, by number, and the squares of the size ``near`` that their ends lie in: a
    line is found by where it ends in a time that does not grow with their number.
    """

    def __init__(self, lines: list[Array], near: float) -> None:
        self.lines, self.near = dict(enumerate(lines)), near
        self.squares: dict[tuple[int, int], dict[tuple[int, bool], Array]] = {}
        for number, line in self.lines.items():
            for backward, end in ((False, line[0]), (True, line[-1])):
                self.squares.setdefault(self._square(end), {})[number, backward] = end

    def take(self, number: int) -> Array:
        """A line, which is free no more."""
        line = self.lines.pop(number)
        for backward, end in ((False, line[0]), (True, line[-1])):
            del self.squares[self._square(end)][number, backward]
        return line

    def meeting(self, point: Array) -> list[tuple[int, bool]]:
        """The lines with an end at ``point``, the first one first, and of each whether that is its last point."""
        column, row = self._square(point)
        around = (self.squares.get((column + i, row + j), {}) for i in (-1, 0, 1) for j in (-1, 0, 1))
        met = (next((key for key, end in ends.items() if math.dist(end, point) <= self.near), None) for ends in around)
        return sorted(key for key in met if key is not None)

    def _square(self, point: Array) -> tuple[int, int]:
        return math.floor(point[0] / self.near), math.floor(point[1] / self.near)


def _only(outlines: tuple[list[Array], int], say: str) -> Array:
    """The one closed outline. Raises SceneError where there is another number, or a line beside it."""
    closed, ends = outlines
    if len(closed) == 1 and not ends:
        return closed[0]
    what = f"{len(closed)} closed outlines and {ends} lines that do not close"
    raise SceneError(f"{say}: has {what}; keep one closed outline in the drawing and join its ends")


def register() -> None:
    """Add the reader of a body's drawing."""
    drawings.add(DXF, read_outline)
