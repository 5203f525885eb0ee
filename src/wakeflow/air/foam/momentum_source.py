"""A force on the air as explicit sources of OpenFOAM's momentum equation: ``constant/fvOptions`` of a case.

Debian's package has no source that reads a field and no compiler for one that is written in code. What it has is a
uniform source in a set of cells (``vectorSemiImplicitSource``, ``volumeMode specific``): each component of the force is
laid on the cells, sorted into LEVELS levels, and the cells of a level are one such set with their mean force. So the
force as a whole is kept to round-off, a cell's own to half a level, and the cost does not grow with the boxes.
"""

from __future__ import annotations

import shutil
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.files import atomic_write, write_json
from ...core.geometry import ForceDensity
from .polymesh import read_polymesh
from .reconstruction import PlaneMesh
from .spanwise.span_record import LAYERS

Array = NDArray[np.float64]
SOURCE = Path("constant", "momentum_source.json")  # in the case, beside the force that was written into it
LEVELS = 32  # of each component, between its least and its largest value. Chosen: off by 2 % of that range in a cell
NOTHING = 1e-12  # of the largest force on a cell: none

_HEADER = "FoamFile {{ version 2.0; format ascii; class {kind}; object {name}; }}\n"
_OPTION = """{name}
{{
    type                vectorSemiImplicitSource;
    active              yes;
    selectionMode       cellSet;
    cellSet             {name};
    volumeMode          specific;
    injectionRateSuSp   {{ U (({x:.12g} {y:.12g} 0) 0); }}      // m/s2
}}
"""


@dataclass(frozen=True)
class LaidForce:
    """What was written: ``force`` (x, y) N per metre across the plane on all meshed ``cells`` that feel one, by so many
    ``sources``, and the most ``pressure`` (Pa) that it adds on a way through the air.
    """

    force: tuple[float, float]
    cells: int
    sources: int
    pressure: float


def cell_forces(force: ForceDensity, mesh: PlaneMesh) -> Array:
    """Force density (m, 2) N/m3 on the cells of ``mesh``: the force in each box spread over the cells whose centres it
    holds, else given to the nearest one; all together it is the force of all boxes.

    Of a half channel, whose symmetry plane x = 0 is a patch ``axis``, only the boxes of that half.
    """
    from scipy.spatial import cKDTree

    boxes = force.boxes
    each = force.density.reshape(-1, 2) * boxes.pitch**2  # N/m
    middles = boxes.centres.reshape(-1, 2)
    if "axis" in mesh.patches:
        side = np.sign(mesh.centres[:, 0].mean())
        each = np.where((side * middles[:, 0] > 0.0)[:, None], each, 0.0)
    area = mesh.areas
    place, density = boxes.holding(mesh.centres), np.zeros((len(area), 2))
    held = (np.abs(mesh.centres - middles[place]) <= 0.5 * boxes.pitch * (1.0 + 1e-9)).all(axis=1)
    covered = np.bincount(place[held], area[held], len(each))
    density[held] = each[place[held]] / covered[place[held]][:, None]
    lonely = np.flatnonzero((covered == 0.0) & (np.abs(each) > 0.0).any(axis=1))
    if len(lonely):
        nearest = cKDTree(mesh.centres).query(middles[lonely])[1]
        np.add.at(density, nearest, each[lonely] / area[nearest][:, None])
    return density


def write_source(folder: Path, force: ForceDensity, density: float, deep: Path | None = None) -> LaidForce:
    """Write ``force`` into the case ``folder``, which has its mesh, for air of ``density`` (kg/m3); what stood there
    before goes. What was written is in ``constant/momentum_source.json`` too. Raises FoamError where there is no mesh.

    Into the case ``deep`` instead, where that is the one in ``folder`` extruded: each layer feels the same.
    """
    mesh = read_polymesh(folder).plane
    cells, area = cell_forces(force, mesh), mesh.areas
    over = np.arange(len(area))  # the plane cell that each cell of the case is over
    if deep is not None:
        with np.load(folder / LAYERS) as data:
            over, folder = data["at"], deep
    sets = folder / "constant" / "polyMesh" / "sets"
    if sets.exists():
        shutil.rmtree(sets)
    sets.mkdir()
    entries = []
    for axis, letter in ((0, "X"), (1, "Y")):
        for number, (members, value) in enumerate(_levels(cells[:, axis], area)):
            name = f"force{letter}{number}"
            members = np.flatnonzero(np.isin(over, members))
            words = "\n".join(map(str, members))
            with atomic_write(sets / name) as stream:
                stream.write(_HEADER.format(kind="cellSet", name=name) + f"{len(members)}\n(\n{words}\n)\n")
            push = [0.0, 0.0]
            push[axis] = value / density
            entries.append(_OPTION.format(name=name, x=push[0], y=push[1]))
    with atomic_write(folder / "constant" / "fvOptions") as stream:
        stream.write(_HEADER.format(kind="dictionary", name="fvOptions") + "\n" + "\n".join(entries))
    total = (area[:, None] * cells).sum(axis=0)
    felt = int((cells != 0.0).any(axis=1).sum())
    laid = LaidForce((float(total[0]), float(total[1])), felt, len(entries), force.pressure)
    write_json(folder / SOURCE, asdict(laid))
    return laid


def _levels(values: Array, area: Array) -> list[tuple[NDArray[np.int64], float]]:
    """Cells of each level of ``values`` (m,) that are not nothing, with their mean by ``area`` (m,)."""
    size = np.abs(values)
    felt = np.flatnonzero(size > NOTHING * max(size.max(initial=0.0), np.finfo(float).tiny))
    if not len(felt):
        return []
    low, high = values[felt].min(), values[felt].max()
    number = np.minimum(((values[felt] - low) / max(high - low, np.finfo(float).tiny) * LEVELS).astype(int), LEVELS - 1)
    members = [felt[number == level] for level in np.unique(number)]
    return [(cells, float(np.average(values[cells], weights=area[cells]))) for cells in members]
