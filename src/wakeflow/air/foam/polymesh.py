"""Read ``constant/polyMesh`` of a one-layer case, ascii or binary, into the plane.

Own few lines instead of foamlib's: foamlib 1.7.10 and 1.9.0 misread large binary ``faces``.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.errors import FoamError
from ...core.files import read_packed
from ..mesh.spec import of_sides
from .reconstruction import PlaneMesh

Index = NDArray[np.intp]


@dataclass(frozen=True)
class FoamMesh:
    """A one-layer OpenFOAM mesh seen as a plane mesh, cells in OpenFOAM's order.

    ``types`` are the patches' types by name, ``groups`` the names under which fields may call several of them;
    ``slots`` (b,) is each boundary edge's place within its patch; ``thickness`` (m).
    """

    plane: PlaneMesh
    types: dict[str, str]
    groups: dict[str, tuple[str, ...]]
    slots: Index
    thickness: float


class Patch(NamedTuple):
    """One patch: its type, number of faces and first face."""

    type: str
    size: int
    start: int
    groups: tuple[str, ...]


def read_polymesh(case: Path) -> FoamMesh:
    """The mesh of ``case``. Raises FoamError when there is none, or it is not one layer of cells normal to z."""
    folder = case / "constant" / "polyMesh"
    if not any((folder / name).exists() for name in ("boundary", "boundary.gz")):
        raise FoamError(f"{case} holds no mesh (constant/polyMesh): give the folder of an OpenFOAM case")
    points = _numbers(folder, "points", "<f8", 3).astype(float).reshape(-1, 3)
    ends, corners = _faces(folder)
    owner = _numbers(folder, "owner").astype(np.intp)
    patches = _boundary(folder)
    flat = np.concatenate(
        [np.arange(p.start, p.start + p.size) for p in patches.values() if p.type == "empty"] or [np.zeros(0, int)]
    )
    count = int(owner.max()) + 1
    if len(flat) != 2 * count:
        raise FoamError(
            f"{case} is not a two-dimensional case of one layer: {count} cells but {len(flat)} faces on patches of "
            "type empty (there must be two a cell)"
        )
    height = points[:, 2]
    middle = (height.min() + height.max()) / 2
    above = height > middle
    lies_above = np.logical_or.reduceat(above[corners], ends[:-1])
    back = flat[~lies_above[flat]]
    if len(back) != count or np.ptp(height[~above]) > 1e-6 * np.ptp(height):
        raise FoamError(f"{case} is not a layer of cells normal to z: rotate it so that the flow lies in the x-y plane")
    return _flatten(points, ends, corners, owner, patches, back, above)


def _flatten(
    points: NDArray[np.float64],
    ends: Index,
    corners: Index,
    owner: Index,
    patches: dict[str, Patch],
    back: Index,
    above: NDArray[np.bool_],
) -> FoamMesh:
    """Project onto the plane: ``back`` holds the face of each cell that lies in it, ``above`` the points outside."""
    renumber = np.full(len(points), -1, dtype=np.intp)
    kept = ~above & np.isin(np.arange(len(points)), corners)  # cells that were taken out may leave points
    renumber[kept] = np.arange(np.count_nonzero(kept))
    flat = np.ascontiguousarray(points[kept, :2])
    cells, centres = _cells(flat, renumber[corners], ends, back[np.argsort(owner[back])])
    shown = {name: entry for name, entry in patches.items() if entry.type != "empty" and entry.size}
    sizes = [entry.size for entry in shown.values()]
    slots = np.concatenate([np.zeros(0, np.intp), *map(np.arange, sizes)])
    chosen = slots + np.repeat([entry.start for entry in shown.values()], sizes)
    nodes = [corners[ends[face] : ends[face + 1]] for face in chosen]
    plane = PlaneMesh(
        points=flat,
        cells=cells,
        centres=centres,
        faces=np.array([renumber[each[~above[each]]] for each in nodes], dtype=np.intp),
        owner=owner[chosen],
        patch=np.repeat(np.arange(len(sizes)), sizes),
        patches=tuple(shown),
    )
    types = {name: entry.type for name, entry in shown.items()}
    groups = {name: (*entry.groups, entry.type) for name, entry in shown.items()}
    return FoamMesh(plane, types, groups, slots, float(np.ptp(points[:, 2])))


def _cells(
    points: NDArray[np.float64], corners: Index, ends: Index, back: Index
) -> tuple[list[Index], NDArray[np.float64]]:
    """The corners of every cell, anticlockwise, and the centroids; ``back``: the cells' faces in the plane, in order.
    Cells of equally many corners are taken together.
    """
    count = np.diff(ends)[back]
    cells: list[Index] = [np.zeros(0, np.intp)] * len(back)
    centres = np.empty((len(back), 2))
    for number in np.unique(count):
        which = np.flatnonzero(count == number)
        nodes = corners[ends[back[which]][:, None] + np.arange(number)]
        turned = of_sides(points[nodes]).sum(axis=1) <= 0.0
        nodes[turned] = nodes[turned, ::-1]
        local = points[nodes] - points[nodes[:, :1]]
        cross = of_sides(local)
        moment = ((local + np.roll(local, -1, axis=1)) * cross[..., None]).sum(axis=1)
        centres[which] = points[nodes[:, 0]] + moment / (3.0 * cross.sum(axis=1))[:, None]
        for cell, those in zip(which, nodes, strict=True):
            cells[cell] = those
    return cells, centres


def _open(folder: Path, name: str) -> tuple[bytes, bool, str, bytes]:
    """Contents after the header, whether they are binary, the numpy type of a label, and the header."""
    path = folder / name
    raw = path.read_bytes() if path.exists() else read_packed(path.with_name(name + ".gz"))
    header = re.search(rb"FoamFile\s*\{(.*?)\}", raw, re.S)
    if header is None:
        raise FoamError(f"{path} has no FoamFile header")
    binary = re.search(rb"format\s+binary", header[1]) is not None
    label = "<i8" if b"label=64" in header[1] else "<i4"
    body = re.sub(rb"^(\s*(//[^\n]*\n|/\*.*?\*/))*", b"", raw[header.end() :], flags=re.S)
    return body if binary else re.sub(rb"//[^\n]*|/\*.*?\*/", b" ", body, flags=re.S), binary, label, header[1]


LIST = re.compile(rb"\s*(\d+)\s*\(")


def _take(body: bytes, at: int, kind: str, width: int) -> tuple[NDArray[np.generic], int]:
    """One binary list ``N(...)`` from byte ``at`` on, and where it ends."""
    match = LIST.match(body, at)
    if match is None:
        raise FoamError("a polyMesh file is cut short or not in a known format")
    count = int(match[1])
    size = np.dtype(kind).itemsize * width * count
    return np.frombuffer(body, kind, count * width, match.end()), match.end() + size + 1


def _numbers(folder: Path, name: str, kind: str = "", width: int = 1) -> NDArray[np.generic]:
    """The numbers of a list, ``width`` in each entry: of a numpy ``kind``, by default labels."""
    body, binary, label, header = _open(folder, name)
    if binary:
        single = bool(kind) and b"scalar=32" in header
        return _take(body, 0, "<f4" if single else kind or label, width)[0]
    words = body[body.find(b"(") + 1 : body.rfind(b")")].translate(bytes.maketrans(b"()", b"  ")).split()
    count = LIST.match(body)
    try:
        if count is None or len(words) != int(count[1]) * width:
            raise ValueError(f"{len(words)} numbers")
        return np.array(words, dtype=kind or np.intp)
    except ValueError as problem:
        raise FoamError(f"{folder / name} is cut short or not in a known format ({problem})") from None


def _faces(folder: Path) -> tuple[Index, Index]:
    """Offsets (f + 1,) and point numbers of all faces, one after the other."""
    body, binary, label, _ = _open(folder, "faces")
    if binary:
        offsets, at = _take(body, 0, label, 1)
        return offsets.astype(np.intp), _take(body, at, label, 1)[0].astype(np.intp)
    faces = re.findall(rb"(\d+)\s*\(([^()]*)\)", body[body.find(b"(") + 1 :])
    offsets = np.concatenate([[0], np.cumsum([int(count) for count, _ in faces])])
    return offsets.astype(np.intp), np.array(b" ".join(nodes for _, nodes in faces).split(), dtype=np.intp)


def _boundary(folder: Path) -> dict[str, Patch]:
    body, _, _, _ = _open(folder, "boundary")
    text = re.sub(r"//[^\n]*|/\*.*?\*/", "", body.decode(), flags=re.S)
    patches = {}
    for name, entry in re.findall(r"([\w.:-]+)\s*\{([^{}]*)\}", text):
        values = dict(re.findall(r"(\w+)\s+([^;]+);", entry))
        patches[name] = Patch(
            values["type"], int(values["nFaces"]), int(values["startFace"]),
            tuple(re.findall(r"[A-Za-z]\w*", values.get("inGroups", "").removeprefix("List<word>"))),
        )  # fmt: skip
    return patches
